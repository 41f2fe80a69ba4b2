#!/usr/bin/env python3
"""Campaigns in a bucket: test.py FLIGHTLAG FLIGHTS [PART-OF-A-NAME ...]; see `run` beside it.

Every test has a bucket of its own. What lies in it afterwards is compared with what the same campaign writes to a folder."""

import gzip, json, os, shutil, subprocess, sys, tempfile, threading, time, traceback, zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from server import changed, started

FLIGHTLAG, FLIGHTS = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
WORK = Path(tempfile.mkdtemp(prefix="flightlag-s3-"))
LOGS = WORK / "flights"
BUSY, NOT_NOW = 75, 75
TESTS = []


def test(function):
    TESTS.append(function)
    return function


def patient_test(function):
    """One that waits for minutes: it runs beside the others, through a proxy of its own."""
    function.is_patient = True
    return test(function)


class Lab:
    """A bucket with the logs, and how flightlag is run on it."""

    def __init__(self, name, proxy, client):
        self.name, self.proxy, self.client = name, proxy, client
        self.cache = WORK / f"cache-{name}"
        client.create_bucket(Bucket=name)
        for path in sorted(p for p in LOGS.rglob("*") if p.is_file()):
            client.upload_file(str(path), name, f"flights/{path.relative_to(LOGS)}")
        self.processes = []
        self.reset()

    def reset(self):
        self.proxy.reset()
        self.proxy.bucket = self.name

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()

    def url(self, prefix):
        return f"s3://{self.name}/{prefix}"

    def start(self, *arguments, **environment):
        env = {k: v for k, v in os.environ.items() if not k.startswith("AWS_")}
        env |= {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1", "AWS_ALLOW_HTTP": "true"}
        env |= {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.proxy.server_port}", "XDG_CACHE_HOME": str(self.cache)}
        env |= environment
        pipe = subprocess.PIPE
        process = subprocess.Popen([FLIGHTLAG, *map(str, arguments)], env=env, stdout=pipe, stderr=pipe, text=True)
        self.processes.append(process)
        return process

    def run(self, *arguments, exit=0, **environment):
        return ended(self.start(*arguments, **environment), exit)

    def campaign(self, *more, flights="flights", out="out", exit=0):
        return self.run("campaign", self.url(flights), "--out", self.url(out), *more, exit=exit)

    def put(self, key, content):
        self.client.put_object(Bucket=self.name, Key=key, Body=content)

    def get(self, key):
        return self.client.get_object(Bucket=self.name, Key=key)["Body"].read()

    def keys(self, prefix):
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=self.name, Prefix=prefix)
        return sorted(o["Key"] for page in pages for o in page.get("Contents", []))

    def tree(self, out="out"):
        return {key[len(out) + 1 :]: self.get(key) for key in self.keys(out + "/")}


def ended(process, exit):
    out, err = process.communicate(timeout=300)
    assert process.returncode == exit, f"exit {process.returncode}, not {exit}\n{out}{err}"
    return out + err


def folder(path):
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def same(found, wanted):
    """Equal but for run.json and the notes in .flightlag; the command on the pages is the same, for it names no place."""
    own = lambda name: name.startswith(".flightlag/") or name == "run.json"
    found, wanted = ({k: v for k, v in tree.items() if not own(k)} for tree in (found, wanted))
    differ = [k for k in sorted(found.keys() | wanted.keys()) if found.get(k) != wanted.get(k)]
    assert not differ, f"differ: {differ}"
    assert len(found) > 20 and "index.html" in found, sorted(found)


def make_logs():
    """Six flights: one compressed, one archived, one with a name that a URL has to escape, one a folder deeper."""
    LOGS.mkdir()
    for n, path in enumerate(sorted(FLIGHTS.glob("**/*.mcap"))):
        content = path.read_bytes()
        if n == 1:
            (LOGS / "b.mcap.gz").write_bytes(gzip.compress(content, mtime=0))
        elif n == 2:
            with zipfile.ZipFile(LOGS / "c.zip", "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("c.mcap", content)
        else:
            name = {0: "a.mcap", 3: "d 1+2 (ü~%41)#.mcap", 4: "day 2/e.mcap"}.get(n, f"f{n}.mcap")
            (LOGS / name).parent.mkdir(exist_ok=True)
            (LOGS / name).write_bytes(content)
    (LOGS / "notes.txt").write_text("no log\n")


def local_run(lab):
    lab.run("campaign", LOGS, "--out", WORK / "local" / "out")
    return folder(WORK / "local" / "out")


@test
def from_bucket_to_bucket_gives_the_bytes_of_a_folder(lab):
    lab.campaign()
    same(lab.tree(), LOCAL)
    # Once more: nothing to do, and no log is opened.
    lab.reset()
    assert "nothing changed" in lab.campaign()
    assert lab.proxy.count("GET", "/flights/") == 0 and lab.proxy.count("PUT", "by-key") == 0
    # Without the cache and the notes all is read again, and nothing is made again.
    shutil.rmtree(lab.cache)
    lab.client.delete_object(Bucket=lab.name, Key="out/.flightlag/state.json")
    lab.client.delete_object(Bucket=lab.name, Key="out/.flightlag/inputs.json")
    lab.reset()
    lab.campaign()
    assert lab.proxy.count("GET", "/flights/") >= 6 and lab.proxy.count("PUT", "by-key") == 0
    same(lab.tree(), LOCAL)


@test
def from_a_folder_to_a_bucket_and_back(lab):
    lab.run("campaign", LOGS, "--out", lab.url("deep/out"))
    same(lab.tree("deep/out"), LOCAL)
    out = WORK / "from-bucket"
    lab.run("campaign", lab.url("flights"), "--out", out)
    same(folder(out), LOCAL)


@test
def delay_of_a_bucket_says_what_delay_of_a_folder_says(lab):
    ours = lab.run("delay", lab.url("flights"), "--quiet")
    assert ours == lab.run("delay", LOGS, "--quiet") and "a.mcap" in ours
    one = lab.run("delay", lab.url("flights/a.mcap"), "--quiet")
    assert one == lab.run("delay", LOGS / "a.mcap", "--quiet") and one.startswith("a.mcap: ")
    told = lab.run("delay", lab.url("nothing"), exit=2)
    assert f"s3://{lab.name}/nothing: no object" in told, told


@test
def tasks_side_by_side_and_one_shard_twice_at_once(lab):
    line = lambda said: dict(word.split("=", 1) for word in said.split() if "=" in word)
    plan = lambda: line(lab.run("campaign", "plan", lab.url("flights"), "--out", lab.url("out"), "--max-shards", "2", "--quiet"))
    for stage in ("measure", "replay"):
        planned = plan()
        assert planned["stage"] == stage and planned["shards"] == "2", planned
        assert planned["manifest"].startswith(lab.url("out/.flightlag/plans/")), planned
        # Both of two equal tasks have made the same result before either may complete it.
        plan_text = json.loads(lab.get(planned["manifest"].removeprefix(lab.url(""))))
        key_of = lambda flight: flight["measure_key" if stage == "measure" else "key"]
        keys = [key_of(flight) for flight in plan_text["flights"] if flight["shard"] == 0]
        met, lock, together = [], threading.Lock(), threading.Barrier(2, timeout=60)

        def meet(method, key):
            if method == "PUT" and key.endswith("/files.json") and key.split("/")[-2] in keys:
                with lock:
                    met.append(key)
                    waits = met.count(key) <= 2 and key == met[0]
                if waits:
                    together.wait()

        lab.reset()
        lab.proxy.before = meet
        task = lambda shard: lab.start("campaign", "task", "--manifest", planned["manifest"], "--shard", shard, "--threads", "1")
        tasks = [task(0), task(0), task(1)]
        said = [ended(process, 0) for process in tasks]
        assert met.count(met[0]) == 2 and not together.broken, said
    assert plan()["shards"] == "0"
    lab.reset()
    lab.run("campaign", "reduce", "--manifest", plan()["manifest"])
    same(lab.tree(), LOCAL)
    assert "6 of 6 flights" in lab.run("campaign", "status", "--manifest", plan()["manifest"])


@test
def two_campaigns_at_once_and_the_second_names_the_owner(lab):
    reached, go_on = threading.Event(), threading.Event()

    def hold(method, key):
        if method == "PUT" and "by-key" in key and not reached.is_set():
            reached.set()
            go_on.wait(60)

    lab.proxy.before = hold
    first = lab.start("campaign", lab.url("flights"), "--out", lab.url("out"))
    assert reached.wait(60)
    told = lab.campaign(exit=BUSY)
    assert f"process {first.pid} on " in told and "campaign s3://" in told and "it was active" in told, told
    go_on.set()
    ended(first, 0)
    same(lab.tree(), LOCAL)
    assert json.loads(lab.get("out/.flightlag/lock"))["released"] is True


@test
def an_owner_elsewhere_keeps_the_lock_until_the_server_says_that_it_is_silent(lab):
    owner = {"owner": "process 7 on node7", "host": "node7", "system": "0badcafe", "process": 7}
    lab.put("out/.flightlag/lock", json.dumps(owner | {"process_start": 7, "heartbeat": 3, "released": False}).encode())
    told = lab.campaign(exit=BUSY)
    assert "process 7 on node7" in told, told
    long_ago = "Mon, 03 Jan 2022 10:00:00 GMT"
    lab.proxy.answers = lambda key, headers: changed(headers, "Last-Modified", long_ago) if key.endswith("/lock") else headers
    told = lab.campaign()
    assert "process 7 on node7 was silent for" in told and "by the clock of the server" in told, told
    same(lab.tree(), LOCAL)


@patient_test
def a_run_that_loses_its_lock_writes_nothing_more(lab):
    reached, go_on = threading.Event(), threading.Event()

    def hold(method, key):
        if method == "PUT" and "by-key" in key and not go_on.is_set():
            reached.set()
            go_on.wait(300)

    lab.proxy.before = hold
    running = lab.start("campaign", lab.url("flights"), "--out", lab.url("out"), AWS_TIMEOUT="300s")
    assert reached.wait(60)
    lock = lambda: json.loads(lab.get("out/.flightlag/lock"))
    first = lock()["heartbeat"]
    patiently(100, lambda: lock()["heartbeat"] == first + 1)
    lab.put("out/.flightlag/lock", json.dumps(lock() | {"owner": "process 7 on node7", "system": "0badcafe"}).encode())
    beats = lab.proxy.count("PUT", "/lock")
    patiently(100, lambda: lab.proxy.count("PUT", "/lock") > beats)
    time.sleep(2)
    go_on.set()
    told = ended(running, NOT_NOW)
    assert "another flightlag took over this output" in told, told
    assert lock()["owner"] == "process 7 on node7" and not [key for key in lab.keys("out/") if key.endswith("/files.json")]


def patiently(seconds, condition):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.2)


@test
def a_run_that_is_killed_goes_on_where_it_was(lab):
    running = []

    def kill(method, key):
        # The third result is on its way: its parts are there, the list that completes it is not.
        if method == "PUT" and key.endswith("/files.json") and lab.proxy.count("PUT", "/files.json") == 3:
            running[0].kill()
            return 503

    lab.proxy.before = kill
    running.append(lab.start("campaign", lab.url("flights"), "--out", lab.url("out")))
    ended(running[0], -9)
    done = [key for key in lab.keys("out/by-key/") if key.endswith("/files.json")]
    assert len(done) == 2, done
    lab.reset()
    told = lab.campaign()
    assert "has ended without releasing it" in told, told
    assert lab.proxy.count("PUT", "/files.json") == 12 - 2
    same(lab.tree(), LOCAL)
    views = lab.cache / "flightlag" / "views"
    assert not list(views.iterdir()), "what the killed run left in the cache is gone"


@test
def a_log_that_is_replaced_after_the_plan_is_refused_and_measured_again_by_the_next(lab):
    planned = lab.run("campaign", "plan", lab.url("flights"), "--out", lab.url("out"), "--max-shards", "1", "--quiet")
    manifest = planned.split("manifest=")[1].strip()
    other = (LOGS / "f5.mcap").read_bytes()
    lab.put("flights/a.mcap", other)
    told = lab.run("campaign", "task", "--manifest", manifest, "--shard", "0", exit=3)
    assert "a.mcap: the log has changed since it was planned" in told, told
    # The same bytes under another tag are the same log.
    lab.put("flights/a.mcap", (LOGS / "a.mcap").read_bytes())
    lab.campaign()
    same(lab.tree(), LOCAL)


@test
def a_log_that_is_replaced_while_it_is_read_gives_no_result(lab):
    # An attempt that failed before there was any log has no claim on the output.
    lab.campaign(flights="none", exit=2)
    calls = []

    def replace(method, key):
        # The second look at the log is that after it was read.
        if method == "HEAD" and key.endswith("/flights/a.mcap"):
            calls.append(key)
            if len(calls) == 2:
                lab.put("flights/a.mcap", (LOGS / "f5.mcap").read_bytes())

    lab.proxy.before = replace
    told = lab.campaign(exit=3)
    assert "a.mcap: the file changed while it was read" in told, told
    lab.reset()
    lab.put("flights/a.mcap", (LOGS / "a.mcap").read_bytes())
    lab.campaign()
    wanted = {k: v for k, v in LOCAL.items() if not k.startswith(("since-last-run", "index.html"))}
    found = {k: v for k, v in lab.tree().items() if k in wanted or k.startswith("flights/")}
    differ = [k for k in wanted if not k.startswith(".flightlag/") and k != "run.json" and found.get(k) != wanted[k]]
    assert not differ, differ


@test
def a_stored_object_that_somebody_changes_is_noticed_and_made_again(lab):
    lab.campaign()
    for more in ((), ("--verify",)):
        key = next(key for key in lab.keys("out/by-key/") if key.endswith("/record.json.gz"))
        there = lab.get(key)
        lab.put(key, there[:-9] + bytes([there[-9] ^ 1]) + there[-8:])
        assert len(lab.get(key)) == len(there)
        told = lab.campaign(*more)
        assert "files that were missing or changed were written again" in told and key[4:] in told, told
        assert lab.get(key) == there
    lab.client.delete_object(Bucket=lab.name, Key="out/flights.csv")
    assert "flights.csv" in lab.campaign()
    same(lab.tree(), LOCAL)


@test
def a_cache_that_is_smaller_than_the_logs_never_holds_more_than_it_may_and_the_log_that_is_read(lab):
    sizes = [path.stat().st_size for path in LOGS.rglob("*") if path.is_file()]
    room, most = 2 * max(sizes), 0

    def look(method, key):
        nonlocal most
        copies = lab.cache / "flightlag" / "objects"
        found = [path.stat().st_size for path in copies.iterdir()] if copies.is_dir() else []
        most = max(most, sum(found))

    lab.proxy.before = look
    lab.campaign("--cache-size", room / 1e9, "--threads", "1")
    assert sum(sizes) > room and 0 < most <= room + max(sizes), (room, most)
    same(lab.tree(), LOCAL)


@test
def a_server_without_conditions_is_refused(lab):
    lab.proxy.headers = lambda key, headers: {k: v for k, v in headers.items() if not k.lower().startswith("if-")}
    told = lab.campaign(exit=1)
    assert f"s3://{lab.name}/out: cannot write to this bucket: the server ignores If-None-Match" in told, told


@test
def what_time_may_heal_ends_with_75_and_what_it_does_not_with_1(lab):
    told = lab.run("campaign", lab.url("flights"), "--out", "s3://no-such-bucket/out", exit=1)
    assert "s3://no-such-bucket/out" in told and "NoSuchBucket" in told, told
    lab.proxy.before = lambda method, key: 403 if method == "PUT" else None
    told = lab.campaign(exit=1)
    assert "403" in told and "trying again will not help" in told, told
    # A server that asks for patience gets it, a few times.
    asked = []
    lab.proxy.before = lambda method, key: asked.append(key) or (503 if method == "PUT" and len(asked) % 3 == 0 else None)
    lab.campaign()
    same(lab.tree(), LOCAL)
    lab.proxy.before = lambda method, key: 503 if key.endswith("state.json") else None
    told = lab.campaign("--replace", exit=NOT_NOW)
    assert "state.json" in told and "try again" in told, told


@test
def another_run_that_wrote_the_notes_meanwhile_is_not_written_over(lab):
    lab.campaign()
    lab.put("flights/f5.mcap", (LOGS / "a.mcap").read_bytes())
    state = lab.get("out/.flightlag/state.json")

    def steal(method, key):
        if method == "PUT" and key.endswith("/out/campaign.json"):
            lab.put("out/.flightlag/state.json", state + b"\n")

    lab.proxy.before = steal
    told = lab.campaign(exit=NOT_NOW)
    assert "another flightlag wrote it in the meantime" in told, told
    assert lab.get("out/.flightlag/state.json") == state + b"\n"


@test
def outputs_that_hold_something_else_are_refused_and_old_results_are_collected(lab):
    lab.put("mine/notes.txt", b"mine")
    told = lab.campaign(out="mine", exit=2)
    assert "holds files that flightlag did not write" in told, told
    assert lab.keys("mine/") == ["mine/notes.txt"]
    told = lab.campaign(out="flights/out", exit=2)
    assert "must not be inside" in told, told
    lab.campaign()
    lab.client.delete_object(Bucket=lab.name, Key="flights/f5.mcap")
    lab.campaign()
    keys = lambda: {key.split("/")[3] for key in lab.keys("out/by-key/")}
    before = len(keys())
    assert "removed 2 results" in lab.run("gc", lab.url("out"))
    assert len(keys()) == before - 2
    assert not any("f5" in key for key in lab.keys("out/flights/"))
    assert "nothing changed" in lab.campaign()


@test
def a_night_takes_its_flights_from_a_bucket(lab):
    night = WORK / "night"
    night.mkdir()
    config = night / "nightly.toml"
    config.write_text(f'schema = 1\nout = "reports"\nsettle_min = 0\n[[campaign]]\nflights = "{lab.url("flights")}"\nname = "all"\n')
    lab.run("nightly", config)
    same(folder(night / "reports" / "all"), LOCAL)
    config.write_text(config.read_text().replace('"reports"', f'"{lab.url("reports")}"'))
    assert "only flights may be in a bucket" in lab.run("nightly", config, exit=2)


def passes(function, lab):
    """Runs a test, and says how it went."""
    try:
        function(lab)
        print(f"ok    {function.__name__}", flush=True)
        return True
    except Exception:
        print(f"FAIL  {function.__name__}\n{traceback.format_exc()}", flush=True)
        return False
    finally:
        lab.end()


def main():
    global LOCAL
    wanted = sys.argv[3:]
    chosen = [t for t in TESTS if not wanted or any(part in t.__name__ for part in wanted)]
    make_logs()
    with started() as (new_proxy, client), ThreadPoolExecutor() as aside:
        proxy = new_proxy()
        LOCAL = local_run(Lab("local", proxy, client))
        patient = [t for t in chosen if hasattr(t, "is_patient")]
        waiting = [aside.submit(passes, t, Lab(f"patient-{n}", new_proxy(), client)) for n, t in enumerate(patient)]
        others = [t for t in chosen if t not in patient]
        passed = [passes(t, Lab(f"lab-{n}", proxy, client)) for n, t in enumerate(others)]
        passed += [done.result() for done in waiting]
    shutil.rmtree(WORK)
    print(f"{sum(passed)} passed, {len(passed) - sum(passed)} failed")
    sys.exit(not all(passed))


main()
