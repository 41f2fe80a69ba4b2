"use strict";
// One finger moves the time window, two zoom it, and a tap sets the cursor. Vertical swipes scroll the page as usual.
const fingers = (panels, whole, view, show) => {
  const down = new Map();
  let begun = null, asked = 0;
  const begin = (over) => {
    const { left, width } = over.getBoundingClientRect(), [from, to] = view();
    begun = { over, at: [...down.values()], from, to, time: (x) => from + (x - left) / width * (to - from), share: (x) => (x - left) / width };
  };
  const move = () => {
    asked = 0;
    const now = [...down.values()];
    if (!begun || now.length !== begun.at.length || now.length === 0) return;
    const { from, to, at, time, share } = begun;
    if (now.length === 1) {
      const by = Math.max(whole[0] - from, Math.min(whole[1] - to, time(at[0]) - time(now[0])));
      return show(from + by, to + by);
    }
    // The point under each finger stays under it.
    const span = (time(at[1]) - time(at[0])) / (share(now[1]) - share(now[0])), start = time(at[0]) - share(now[0]) * span;
    if (span > 0 && Number.isFinite(span)) show(Math.max(whole[0], start), Math.min(whole[1], start + span));
  };
  panels.addEventListener("pointerdown", (event) => {
    const over = event.target.closest(".u-over");
    if (event.pointerType !== "touch" || !over || down.size === 2) return;
    down.set(event.pointerId, event.clientX);
    begin(over);
  });
  panels.addEventListener("pointermove", (event) => {
    if (!down.has(event.pointerId)) return;
    down.set(event.pointerId, event.clientX);
    asked ||= requestAnimationFrame(move);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    addEventListener(end, (event) => { if (down.delete(event.pointerId) && begun) begin(begun.over); });
  }
};
