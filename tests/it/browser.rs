//! Controls a real browser over the Chrome DevTools Protocol.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;
use tungstenite::{Message, WebSocket};

/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// One page of a headless Chromium.
pub struct Browser {
    chromium: Child,
    socket: WebSocket<TcpStream>,
    session: String,
    calls: u64,
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// `None`, with a message, if there is no Chromium.
    pub fn start() -> Option<Browser> {
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new("chromium");
        command.args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--remote-debugging-port=0",
            "--no-first-run",
        ]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg("about:blank");
        // Files that it leaves when it is killed are removed with the profile.
        command.env("TMPDIR", profile.path());
        let Ok(mut chromium) = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn() else {
            println!("skipped: no chromium here");
            return None;
        };
        let Some(address) = address(chromium.stderr.take().unwrap()) else {
            println!("skipped: chromium does not start here");
            let _ = chromium.kill();
            let _ = chromium.wait();
            return None;
        };
        let stream = TcpStream::connect(address.split('/').next().unwrap()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(format!("ws://{address}"), stream).unwrap();
        let session = String::new();
        let mut browser = Browser { chromium, socket, session, calls: 0, events: vec![], _profile: profile };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached = json!({ "targetId": target["targetId"], "flatten": true });
        browser.session = browser.call("Target.attachToTarget", attached)["sessionId"].as_str().unwrap().to_owned();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        // A page in the background is not drawn.
        browser.call("Page.bringToFront", json!({}));
        Some(browser)
    }

    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": parameters });
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        self.socket.send(Message::text(message.to_string())).unwrap();
        loop {
            let answer = self.receive();
            if answer["id"] == self.calls {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].clone();
            }
        }
    }

    fn receive(&mut self) -> Value {
        let message = self.socket.read().unwrap();
        let value: Value = serde_json::from_str(message.to_text().unwrap()).unwrap();
        if value["id"].is_null() {
            self.events.push(value.clone());
        }
        value
    }

    /// Opens a file, optionally with a fragment, and forgets the events of the previous page.
    pub fn open(&mut self, path: &Path, fragment: &str) {
        // Forces a new document even if only the fragment differs.
        self.call("Page.navigate", json!({ "url": "about:blank" }));
        self.events.clear();
        let url = format!("file://{}{fragment}", path.display());
        self.call("Page.navigate", json!({ "url": url }));
        while self.eval("document.readyState === 'complete' && location.protocol === 'file:'") != true {
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    pub fn size(&mut self, width: u32, height: u32, scheme: &str) {
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", metrics);
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Value of an expression, awaited if it is a promise.
    pub fn eval(&mut self, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", asked);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].clone()
    }

    pub fn number(&mut self, expression: &str) -> f64 {
        let value = self.eval(expression);
        value.as_f64().unwrap_or_else(|| panic!("{expression}: {value}"))
    }

    pub fn text(&mut self, expression: &str) -> String {
        self.eval(expression).as_str().unwrap_or_default().to_owned()
    }

    /// Waits until an expression is true.
    pub fn until(&mut self, expression: &str) {
        let begin = std::time::Instant::now();
        while self.eval(expression) != true {
            assert!(begin.elapsed() < PATIENCE, "never true: {expression}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], pressed: bool) {
        let button = if pressed || kind == "mouseReleased" { "left" } else { "none" };
        let event =
            json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": i32::from(pressed), "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", event);
    }

    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.drag_with(from, to, 0);
    }

    /// The same with Shift held.
    pub fn shift_drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.drag_with(from, to, 8);
    }

    /// Fingers that move from one set of positions to another.
    pub fn touch(&mut self, from: &[[f64; 2]], to: &[[f64; 2]]) {
        let points = |share: f64| -> Vec<Value> {
            let place = |(id, (a, b)): (usize, (&[f64; 2], &[f64; 2]))| json!({ "x": a[0] + share * (b[0] - a[0]), "y": a[1] + share * (b[1] - a[1]), "id": id });
            from.iter().zip(to).enumerate().map(place).collect()
        };
        let mut act = |kind: &str, points: Vec<Value>| {
            self.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points }));
        };
        act("touchStart", points(0.0));
        (1..=4).for_each(|step| act("touchMove", points(f64::from(step) / 4.0)));
        // The page draws once per frame.
        self.eval("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
        self.call("Input.dispatchTouchEvent", json!({ "type": "touchEnd", "touchPoints": [] }));
    }

    /// Smallest text in the figures of a page as drawn, CSS pixels, and which text it is.
    pub fn smallest_figure_text(&mut self) -> (f64, String) {
        let found = self.eval(
            "[...document.querySelectorAll('figure svg text')].filter((t) => t.getBoundingClientRect().width > 0).map((t) => { \
             const svg = t.ownerSVGElement, scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width; \
             return [parseFloat(getComputedStyle(t).fontSize) * scale, svg.closest('figure').id + ': ' + t.textContent]; }) \
             .reduce((a, b) => (b[0] < a[0] ? b : a), [Infinity, ''])",
        );
        (found[0].as_f64().unwrap_or(f64::INFINITY), found[1].as_str().unwrap_or_default().to_owned())
    }

    fn drag_with(&mut self, from: [f64; 2], to: [f64; 2], modifiers: u8) {
        let mut act = |kind: &str, [x, y]: [f64; 2], buttons: u8| {
            let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1, "modifiers": modifiers });
            self.call("Input.dispatchMouseEvent", event);
        };
        act("mouseMoved", from, 0);
        act("mousePressed", from, 1);
        for step in 1..=4 {
            let share = f64::from(step) / 4.0;
            act("mouseMoved", [0, 1].map(|k| from[k] + share * (to[k] - from[k])), 1);
        }
        act("mouseReleased", to, 0);
    }

    /// What axe-core finds wrong with the open page, as `rule: first element`; `None`, with a message, if npm did not
    /// provide axe-core (`.ci/run` requests it).
    pub fn accessibility_faults(&mut self) -> Option<Vec<String>> {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/axe/node_modules/axe-core/axe.min.js");
        let Ok(script) = std::fs::read_to_string(&script) else {
            println!("skipped: no axe-core at {}", script.display());
            return None;
        };
        self.eval(&format!("{script}; true"));
        let found =
            self.eval("axe.run().then((r) => r.violations.map((v) => v.id + ': ' + v.nodes[0].html.slice(0, 200)))");
        Some(found.as_array().unwrap().iter().map(|fault| fault.as_str().unwrap().to_owned()).collect())
    }

    pub fn key(&mut self, key: &str) {
        let text = if key.len() == 1 { key } else { "" };
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key, "text": text }));
        }
    }

    /// Number of pages of its printed PDF.
    pub fn printed_pages(&mut self) -> usize {
        let pdf = self.printed();
        let text = String::from_utf8_lossy(&pdf);
        text.matches("/Type /Page").count() - text.matches("/Type /Pages").count()
    }

    fn printed(&mut self) -> Vec<u8> {
        use base64::Engine;
        let asked = json!({ "preferCSSPageSize": true, "printBackground": false });
        let pdf = self.call("Page.printToPDF", asked)["data"].as_str().unwrap().to_owned();
        base64::engine::general_purpose::STANDARD.decode(pdf).unwrap()
    }

    /// Switches to print media, or back to screen.
    pub fn print_media(&mut self, on: bool) {
        self.call("Emulation.setEmulatedMedia", json!({ "media": if on { "print" } else { "" } }));
    }

    /// Width and height of the first page of its printed PDF, points.
    pub fn printed_size(&mut self) -> [f64; 2] {
        let pdf = self.printed();
        let text = String::from_utf8_lossy(&pdf);
        let (_, after) = text.split_once("/MediaBox [").unwrap();
        let numbers: Vec<f64> =
            after.split(']').next().unwrap().split_whitespace().map(|n| n.parse().unwrap()).collect();
        [numbers[2], numbers[3]]
    }

    /// Everything the page did but must not do: errors, and requests for anything but itself.
    pub fn faults(&mut self) -> Vec<String> {
        self.eval("new Promise((done) => setTimeout(done, 50))");
        let fault = |event: &Value| {
            let parameters = &event["params"];
            match event["method"].as_str().unwrap_or_default() {
                "Runtime.exceptionThrown" => Some(parameters["exceptionDetails"].to_string()),
                "Runtime.consoleAPICalled" if parameters["type"] == "error" => Some(parameters["args"].to_string()),
                "Log.entryAdded" => Some(parameters["entry"].to_string()),
                "Network.requestWillBeSent" if parameters["type"] != "Document" => {
                    Some(parameters["request"]["url"].to_string())
                }
                _ => None,
            }
        };
        self.events.iter().filter_map(fault).collect()
    }
}

/// The address it listens on; `None` if it does not report one in time. Keeps reading, so that later messages do not
/// fill the pipe.
fn address(errors: ChildStderr) -> Option<String> {
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(errors).lines().map_while(Result::ok) {
            if let Some(address) = line.trim().strip_prefix("DevTools listening on ws://") {
                // The receiver may have given up.
                let _ = sender.send(address.to_owned());
            }
        }
    });
    receiver.recv_timeout(PATIENCE).ok()
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.chromium.kill();
        let _ = self.chromium.wait();
    }
}
