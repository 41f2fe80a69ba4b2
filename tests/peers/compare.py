#!/usr/bin/env python3
"""Every value of every log beside what the field's own readers say: compare.py DUMP LOGS [PART-OF-A-PATH ...]

DUMP is the example dump_topics of ingest, LOGS a folder of logs; they are found by the ends of their names. The readers,
from PyPI: pyulog (ULog), pymavlink (DataFlash), rosbags (ROS 1 and ROS 2 bags), mcap with mcap-ros1-support,
mcap-ros2-support and mcap-protobuf-support (MCAP). Logs whose reader is not installed are skipped, and counted.

An intact log must agree in topics, messages, stamps and every value, bit for bit after the reader's own widening (NaN
equals NaN). A damaged one must give at least the messages that its reader gives before it stops, and be marked. Exit code
1 if anything differs that is not ALLOWED."""

import collections, contextlib, dataclasses, importlib, io, json, re, shutil, subprocess, sys, tempfile
from pathlib import Path

DAMAGED = re.compile(r"trunc|bitflip|tailjunk|unindexed|corrupt|not_closed|with_padding")  # the last: no channel
WHOLE, STRIDE = 2000, 4999  # of a longer array so many elements are compared, and one in so many of the others
BATCH = 90_000  # bytes of field names in one request
# What may differ: part of the log's path, part of the topic and field, why.
ALLOWED = [
    ("px4-ulog-rs", "has_vtol_approach", "a bool whose byte is neither 0 nor 1 is 1 with us; pyulog gives the byte"),
]


class Topic:
    """Messages of a topic: stamps as far as the reader has them; by path the rows and their values."""

    def __init__(self):
        self.messages, self.logged, self.published, self.columns = 0, [], [], {}

    def add(self, path, value):
        rows, values = self.columns.setdefault(path, ([], []))
        rows.append(self.messages)
        values.append(value)


class Peer:
    """What a reader finds in a log."""

    def __init__(self):
        self.topics = collections.defaultdict(Topic)
        self.undecoded = {}  # why, by topic
        self.not_compared = 0

    def messages(self):
        return sum(t.messages for t in self.topics.values())

    def decode(self, key, decoder, data):
        """The message, or a note that this topic cannot be decoded."""
        if key not in self.undecoded:
            try:
                self.leaves(self.topics[key], "", decoder(data))
            except Exception as e:
                self.undecoded[key] = f"{type(e).__name__}: {e}"

    def leaves(self, topic, path, value):
        """All numbers and texts of a message of any of the libraries."""
        if isinstance(value, (bool, int, float, str, np.generic)):
            topic.add(path, value)
        elif hasattr(value, "__len__") and not isinstance(value, dict):
            chosen = [*range(min(len(value), WHOLE)), *range(WHOLE, len(value), STRIDE)]
            self.not_compared += len(value) - len(chosen)
            for i in chosen:
                self.leaves(topic, f"{path}[{i}]", value[i])
        elif hasattr(value, "DESCRIPTOR"):
            self.protobuf(topic, path, value)
        elif value is not None:
            parts = parts_of(value)
            if set(parts) in ({"sec", "nanosec"}, {"secs", "nsecs"}):
                nanos, seconds = (int(parts[n]) for n in sorted(parts, key=lambda n: n[0]))
                return topic.add(path, seconds * 10**9 + nanos)
            for name, part in parts.items():
                self.leaves(topic, f"{path}.{name}" if path else name, part)

    def protobuf(self, topic, path, message):
        if message.DESCRIPTOR.full_name in ("google.protobuf.Timestamp", "google.protobuf.Duration"):
            return topic.add(path, message.seconds * 10**9 + message.nanos)
        for field in message.DESCRIPTOR.fields:
            if field.type == field.TYPE_BYTES:
                self.not_compared += 1
            elif not field.has_presence or message.HasField(field.name):
                self.leaves(topic, f"{path}.{field.name}" if path else field.name, getattr(message, field.name))


def parts_of(value):
    if isinstance(value, dict):
        return value
    names = getattr(type(value), "__slots__", None) or vars(value)
    if dataclasses.is_dataclass(value):  # of rosbags, among whose fields are constants
        names = [f.name for f in dataclasses.fields(value) if not f.type.startswith("ClassVar")]
    return {name: getattr(value, name) for name in names if not name.startswith("_")}


def plain(type_name):
    return type_name.replace("/msg/", "/")


def zero_ended(raw):
    return raw.split(b"\0")[0].decode("utf8", "replace")


def read_ulog(path, peer):
    for data in pyulog.ULog(str(path)).data_list:
        topic = peer.topics[(data.name + (f"_{data.multi_id}" if data.multi_id else ""), data.name)]
        stamps = data.data["timestamp"]
        topic.messages, topic.logged = len(stamps), [int(t) * 1000 for t in stamps]
        texts = collections.defaultdict(list)
        for field in data.field_data:
            if field.type_str == "char":
                texts[re.sub(r"\[\d+\]$", "", field.field_name)].append(data.data[field.field_name])
            elif "_padding" not in field.field_name:
                topic.columns[field.field_name] = (range(len(stamps)), data.data[field.field_name])
        for name, letters in texts.items():
            lines = [zero_ended(bytes(int(c) & 255 for c in line)) for line in zip(*letters)]
            topic.columns[name] = (range(len(stamps)), lines)


def read_dataflash(path, peer):
    log = dfreader.DFReader_binary(str(path))
    while (message := log._parse_next()) is not None:
        kind, instance = message.get_type(), message.fmt.instance_field
        number = getattr(message, instance) if instance else 0
        topic = peer.topics[(f"{kind}_{number}" if number else kind, kind)]
        for name in message.fmt.columns:
            value = getattr(message, name)
            peer.leaves(topic, name, zero_ended(value) if isinstance(value, bytes) else value)
            if name == "TimeUS":
                topic.logged.append(value * 1000)
        topic.messages += 1


def read_ros_bag(path, peer):
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)  # for bags from before bags held definitions
    with highlevel.AnyReader([path], default_typestore=types) as bag:
        for connection, stamp, data in bag.messages():
            key = (connection.topic, plain(connection.msgtype))
            peer.decode(key, lambda raw: bag.deserialize(raw, connection.msgtype), data)
            peer.topics[key].logged.append(stamp)
            peer.topics[key].messages += 1


def read_mcap(path, peer):
    decoders = {}
    factories = [ros1.DecoderFactory(), ros2.DecoderFactory(), protobuf.DecoderFactory()]
    with open(path, "rb") as file:
        for schema, channel, message in reader.NonSeekingReader(file).iter_messages(log_time_order=False):
            key = (channel.topic, plain(schema.name if schema else ""))
            if channel.id not in decoders:
                found = [f.decoder_for(channel.message_encoding, schema) for f in factories]
                found.append(json.loads if channel.message_encoding == "json" else None)
                decoders[channel.id] = next(filter(None, found), None)
            if decoders[channel.id]:
                peer.decode(key, decoders[channel.id], message.data)
            else:
                peer.undecoded[key] = f"no decoder for {channel.message_encoding!r}"
            topic = peer.topics[key]
            topic.logged.append(message.log_time)
            topic.published.append(message.publish_time)
            topic.messages += 1


class Ours:
    """What dump_topics says of a log."""

    def __init__(self, dump, path, requests=()):
        done = subprocess.run([dump, str(path), *requests], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.error, self.messages, self.loss, self.at = None, 0, "", 0
        self.tables, self.counts, self.ends = {}, collections.Counter(), {}
        if done.returncode:
            self.error = self.loss = done.stderr.decode().strip()
            return
        line, _, self.numbers = done.stdout.partition(b"\n")
        head = json.loads(line)
        self.messages = head["health"]["messages"]
        self.loss = next((n["text"] for n in head["notices"] if n["severity"] == "loss"), "")
        for topic in head["health"]["topics"]:
            key = (topic["name"], plain(topic["type_name"]))
            self.counts[key] += topic["messages"]
            self.ends[key] = [(s["first_ns"], s["last_ns"]) for s in topic["stamps"] if s["kind"] == "logged"]
        for table in head["tables"]:
            self.tables[(table["topic"], plain(table["type"]))] = self.table(table)

    def table(self, head):
        """Rows, stamps, and by path the texts, or which values are there and all of them."""
        rows, columns = head["rows"], {}
        stamps = [self.take("<i8", rows) if head[kind] else None for kind in ("logged", "published")]
        for column in head["columns"]:
            if column["kind"] == "text":
                columns[column["path"]] = column["texts"]
            else:
                there = self.take("u1", rows).astype(bool)
                columns[column["path"]] = (there, self.take({"f64": "<f8", "i64": "<i8", "u64": "<u8"}[column["kind"]], rows))
        return rows, stamps, columns

    def take(self, kind, rows):
        array = np.frombuffer(self.numbers, kind, rows, self.at)
        self.at += array.nbytes
        return array


def requests(ours, peer):
    """Fields that are read only by name (elements of arrays of any length), in batches."""
    batches = collections.defaultdict(dict)
    for key, topic in peer.topics.items():
        size = 0
        for path, (_, values) in topic.columns.items():
            if key in ours.tables and path not in ours.tables[key][2] and "[" in path:
                name = f'"{path}' if isinstance(values[0], str) else path
                size += len(name.encode()) + 1
                batches[size // BATCH].setdefault(key[0], []).append(name)
    return [[f"{topic}={','.join(names)}" for topic, names in batch.items()] for batch in batches.values()]


def unequal(ours, rows, values, my_order, their_order):
    """The first row that differs, what we have there, what the reader has. Both in order of time."""
    total, rows = len(my_order), np.asarray(rows)
    if isinstance(ours, list):
        theirs = np.full(total, None, object)
        theirs[rows] = values
        pairs = zip([ours[i] for i in my_order], theirs[their_order])
        return next(((i, a, b) for i, (a, b) in enumerate(pairs) if a != b), None)
    there, mine = ours[0][my_order], ours[1][my_order]
    exact = np.asarray(values)
    if exact.dtype.kind not in "biuf" or (mine.dtype.kind in "iu" and exact.dtype.kind == "f"):
        return 0, mine.dtype.name, exact.dtype.name
    theirs, expected = np.zeros(total, mine.dtype), np.zeros(total, bool)
    theirs[rows], expected[rows] = exact.astype(mine.dtype), True
    theirs, expected = theirs[their_order], expected[their_order]
    same = theirs.view("u8") == mine.view("u8")
    if mine.dtype.kind == "f":
        same |= np.isnan(theirs) & np.isnan(mine)
    wrong = np.flatnonzero((expected != there) | (expected & ~same))
    shown = [(x[i].item() if ok[i] else None) for i in wrong[:1] for x, ok in ((mine, there), (theirs, expected))]
    return (int(wrong[0]), *shown) if len(wrong) else None


def by_time(stamps, rows):
    return np.argsort(np.asarray(stamps, np.int64), kind="stable") if len(stamps) == rows else np.arange(rows)


def compare(dump, path, ours, peer, keeps_order):
    """How many values were compared; notes; differences."""
    differences, values = [], 0
    theirs = {key: topic.messages for key, topic in peer.topics.items()}
    for key in sorted((+ours.counts).keys() | theirs.keys()):
        if ours.counts[key] != theirs.get(key, 0):
            differences.append(f"{key}: {ours.counts[key]} messages, the reader has {theirs.get(key, 0)}")
    for batch in requests(ours, peer):
        for key, (_, _, columns) in Ours(dump, path, batch).tables.items():
            ours.tables[key][2].update(columns)
    for key, topic in peer.topics.items():
        if key not in ours.tables:
            differences += [f"{key}: not decoded"] * bool(topic.columns)
            if topic.logged and ours.ends.get(key) != [(topic.logged[0], topic.logged[-1])]:
                differences.append(f"{key}: first and last stamp {ours.ends.get(key)}, not as in the reader")
            continue
        rows, stamps, columns = ours.tables[key]
        if rows != topic.messages:
            differences.append(f"{key}: {rows} rows of {topic.messages} messages")
            continue
        orders = [by_time([] if keeps_order else s, rows) for s in (stamps[0], topic.logged)]
        for name, a, b in zip(("logged", "published"), stamps, (topic.logged, topic.published)):
            values += len(b)
            if b and not np.array_equal(a[orders[0]], np.asarray(b, np.int64)[orders[1]]):
                differences.append(f"{key}: {name} stamps differ")
        for name, (at, cells) in topic.columns.items() if key not in peer.undecoded else ():
            values += len(cells)
            if name in columns:
                wrong = unequal(columns.pop(name), at, cells, *orders)
                text = wrong and f"{key}.{name}: row {wrong[0]}: {wrong[1]!r}, the reader has {wrong[2]!r}"
            else:
                text = f"{key}.{name}: absent, the reader has {cells[0]!r}"
            differences += [text] * bool(text)
        if key not in peer.undecoded:
            differences += [f"{key}.{name}: a column that the reader does not have" for name in columns]
    why = next(iter(peer.undecoded.values()), "")
    notes = [f"{len(peer.undecoded)} topics by counts, first and last stamp only ({why[:80]})"] * bool(why)
    notes += [f"{peer.not_compared} fields of bytes or elements of long arrays not compared"] * bool(peer.not_compared)
    return values, notes, differences


# The reader, its modules, ends of the names of its logs, how it reads, whether it keeps the order of the file.
READERS = [
    ("pyulog", {"pyulog": "pyulog"}, (".ulg", ".ulg.zip"), read_ulog, True),
    ("pymavlink", {"dfreader": "pymavlink.DFReader"}, (".bin",), read_dataflash, True),
    ("rosbags", {"highlevel": "rosbags.highlevel", "typesys": "rosbags.typesys"}, (".bag", "metadata.yaml"),
     read_ros_bag, False),
    ("mcap", {"reader": "mcap.reader", "ros1": "mcap_ros1.decoder", "ros2": "mcap_ros2.decoder",
              "protobuf": "mcap_protobuf.decoder"}, (".mcap",), read_mcap, True),
]


def beside(path, read, keeps_order, dump):
    """One log: the cells of its row, and whether all is well."""
    ours, peer, error = Ours(dump, path), Peer(), ""
    with tempfile.TemporaryDirectory() as folder:
        if path.suffix == ".zip":
            shutil.unpack_archive(path, folder)
        inner = next(Path(folder).rglob("*.ulg"), path)
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                read(inner, peer)
        except (Exception, SystemExit) as e:  # readers end with any kind of error
            error = f"{type(e).__name__}: {str(e)[:70]}"
    row, damaged = [len(peer.topics), ours.messages, peer.messages()], bool(DAMAGED.search(path.name))
    said = [f"the reader stops: {error}"] * bool(error) + [f"ours: {ours.loss[:90]}"] * bool(ours.loss)
    if ours.error or error and not damaged or damaged and ours.messages != peer.messages():
        good = bool(ours.loss) and ours.messages >= peer.messages() if damaged else not ours.error
        return [*row, 0, 0], ["; ".join(["skipped"] * (not damaged) + said)], good
    values, notes, differences = compare(dump, path, ours, peer, keeps_order)
    allowed = {d: why for d in differences for log, part, why in ALLOWED if log in str(path) and part in d}
    different = [d for d in differences if d not in allowed]
    notes += [f"known: {why}" for why in allowed.values()] + said
    good = not different and (bool(ours.loss) or not damaged)
    return [*row, values, len(different)], ["; ".join(notes), *different[:5]], good


def main():
    dump, folder, parts = sys.argv[1], Path(sys.argv[2]).resolve(), sys.argv[3:]
    if not folder.is_dir():
        return print(f"skipped: {folder} is not there")
    total = collections.Counter(logs=0, messages=0, values=0, differ=0)
    print(f"{'log':58} {'reader':9} topics     ours   reader    values  differ")
    for name, modules, ends, read, keeps_order in READERS:
        logs = sorted(p for p in folder.rglob("*") if p.name.lower().endswith(ends) and p.is_file())
        logs = [p.parent if p.name == "metadata.yaml" else p for p in logs]
        logs = [p for p in logs if not parts or any(part in str(p) for part in parts)]
        try:
            for short, module in [("np", "numpy"), *modules.items()]:
                globals()[short] = importlib.import_module(module)
        except ImportError as e:
            print(f"{'':58} {name:9} skipped: {e} ({len(logs)} logs)")
            continue
        for path in logs:
            cells, notes, good = beside(path, read, keeps_order, dump)  # differences follow the first note
            suite = path.relative_to(folder).parts[0]
            total.update({"logs": 1, "messages": cells[1], "values": cells[3], "differ": int(not good), f"of {suite}": 1})
            if not good or suite != "mcap-conformance":  # hundreds of them
                row = "{:58} {:9} {:6} {:8} {:8} {:9} {:7}  ".format(f"{suite}/{path.name}"[-58:], name, *cells)
                print(row + "\n      ".join(notes), flush=True)
    print("in all: " + ", ".join(f"{count} {what}" for what, count in total.items()))
    return int(total["differ"] > 0)


sys.exit(main())
