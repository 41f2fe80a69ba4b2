"""An S3 server, moto, behind a proxy that counts requests and breaks what it is told to."""

import contextlib, http.client, http.server, socket, subprocess, sys, threading, time, urllib.parse

import boto3


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def changed(headers, name, value):
    """Headers with one of them changed, however its name is written."""
    return {k: v for k, v in headers.items() if k.lower() != name.lower()} | {name: value}


class Proxy(http.server.ThreadingHTTPServer):
    """Hands requests on. `before(method, key)` may wait, act, or give a status to be answered instead; `headers` and
    `answers` may change the headers of a request and of an answer."""

    daemon_threads = True

    def __init__(self, server_port):
        super().__init__(("127.0.0.1", 0), Handler)
        self.server_port_behind = server_port
        self.lock = threading.Lock()
        self.reset()

    def reset(self):
        self.seen = []
        self.before = lambda method, key: None  # of requests for `bucket` alone
        self.bucket = ""
        self.headers = lambda key, headers: headers
        self.answers = lambda key, headers: headers

    def handle_error(self, *_):
        """A client that is killed leaves its connections; the tests say what else goes wrong."""

    def count(self, method, part):
        with self.lock:
            return sum(m == method and part in key for m, key in self.seen)


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def handle_any(self):
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(length) if length else None
        key = urllib.parse.unquote(self.path)
        with self.server.lock:
            self.server.seen.append((self.command, key))
        status = self.server.before(self.command, key) if key.startswith(f"/{self.server.bucket}/") else None
        if status is not None:
            return self.answer(status, {"Content-Type": "application/xml"}, b"<Error><Code>SlowDown</Code></Error>")
        headers = self.server.headers(key, dict(self.headers.items()))
        behind = http.client.HTTPConnection("127.0.0.1", self.server.server_port_behind, timeout=60)
        behind.request(self.command, self.path, body, headers)
        got = behind.getresponse()
        content = got.read()
        wanted = {k: v for k, v in got.getheaders() if k.lower() not in ("connection", "transfer-encoding", "date", "server")}
        self.answer(got.status, self.server.answers(key, wanted), content)
        behind.close()

    def answer(self, status, headers, content):
        self.send_response(status)
        if self.command != "HEAD":
            headers = {k: v for k, v in headers.items() if k.lower() != "content-length"}
            headers["Content-Length"] = str(len(content))
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                self.wfile.write(content)

    do_GET = do_PUT = do_POST = do_DELETE = do_HEAD = handle_any


@contextlib.contextmanager
def started():
    """What makes a proxy before a server, and a client that goes past all proxies."""
    port = free_port()
    command = [sys.executable, "-c", "from moto.server import main; main()", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(300):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                break
            time.sleep(0.1)
        else:
            sys.exit("the server does not start")

        def new_proxy():
            proxy = Proxy(port)
            threading.Thread(target=proxy.serve_forever, daemon=True).start()
            return proxy

        keys = dict(aws_access_key_id="test", aws_secret_access_key="test", region_name="us-east-1")
        yield new_proxy, boto3.client("s3", endpoint_url=f"http://127.0.0.1:{port}", **keys)
    finally:
        server.kill()
        server.wait()
