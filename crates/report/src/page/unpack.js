"use strict";
// Decompresses the packed data of the page (raw deflate in base64) and starts the packed script.
const inflated = (text) => {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")));
};
(async () => {
  const packed = document.getElementById("packed-script");
  if (!packed || typeof DecompressionStream === "undefined") return;
  const script = document.createElement("script");
  script.textContent = await inflated(packed.textContent).text();
  document.body.append(script);
})();
