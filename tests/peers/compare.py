#!/usr/bin/env python3
"""Every value of every log beside what the field's own readers say: compare.py DUMP LOGS [PART-OF-A-PATH ...]

DUMP is the example dump_topics of ingest, LOGS a folder of logs; they are found by the ends of their names. The readers,
from PyPI: pyulog (ULog), pymavlink (DataFlash, telemetry), rosbags (ROS 1 and ROS 2 bags), mcap with mcap-ros1-support,
mcap-ros2-support and mcap-protobuf-support (MCAP), pyubx2 (UBX), pynmeagps (NMEA). NovAtel's text is taken apart here by
the columns of its manual. Logs whose reader is not installed are skipped, and counted.

An intact log must agree in topics, messages, stamps and every value, bit for bit after the reader's own widening (NaN
equals NaN). A damaged one must give at least the messages that its reader gives before it stops, and be marked. Exit code
1 if anything differs that is not ALLOWED."""

import collections, contextlib, csv, dataclasses, importlib, io, json, re, shutil, subprocess, sys, tempfile
from datetime import datetime, timezone
from fractions import Fraction
from pathlib import Path

DAMAGED = re.compile(r"trunc|bitflip|tailjunk|unindexed|corrupt|not_closed|with_padding")  # the last: no channel
WHOLE, STRIDE = 2000, 4999  # of a longer array so many elements are compared, and one in so many of the others
BATCH = 90_000  # bytes of field names in one request
# Columns that our readers work out from several messages, and `utc_ns`, which is compared where the sentence has a date.
DERIVED = {"gps_week", "gps_tow_ms", "fix_ok", "elapsed_ns", "logged_ns", "utc_ns", "solution_ok", "horizontal_std", "fix", "carrier", "use_flags"}
DERIVED |= {f"{front}_{axis}" for front in ("at", "place") for axis in "xyz"}
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
        self.joined = collections.defaultdict(Topic)  # sentences of one kind by all talkers
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


def read_telemetry(path, peer):
    """Every frame that pymavlink accepts, and the fields that its payload had. (Its own walk through a file loses frames
    where the log goes from MAVLink 2 to 1.)"""
    log, data = all_messages.MAVLink(None), path.read_bytes()
    main, frames, at = None, [], 0
    front = 0 if path.suffix == ".raw" else 8  # the time of reception
    while at + front + 1 < len(data):
        head = {0xFE: 8, 0xFD: 12}.get(data[at + front])
        signed = 13 if head == 12 and data[at + front + 2:at + front + 3] == b"\1" else 0
        length = head and front + head + data[at + front + 1] + signed
        try:
            message = decoded(log, data[at + front:at + length], head)
        except (TypeError, all_messages.MAVError):
            known = length and data[at + length + front:at + length + front + 1] in (b"\xfe", b"\xfd")  # one behind it
            at += length if known else 1
            continue
        sender = message.get_srcSystem(), message.get_srcComponent()
        if message.get_type() == "HEARTBEAT" and message.autopilot != 8 and message.type != 6:
            main = min(main or sender, sender)
        frames.append((sender, int.from_bytes(data[at:at + front], "big") * 1000, message))
        at += length
    main = main or (1, 1)
    for sender, logged, message in frames:
        kind = message.get_type().replace("UNKNOWN_", "MESSAGE_")
        end = "" if sender == main else f"@{sender[0]}" if sender[1] == main[1] else f"@{sender[0]}.{sender[1]}"
        topic = peer.topics[(kind + end, kind)]
        topic.logged.extend([logged] * (front > 0))
        left = len(message.get_payload()) if message.get_msgbuf()[0] == 0xFE else 255
        for name in getattr(message, "ordered_fieldnames", ()):
            at = message.fieldnames.index(name)
            count, raw = message.array_lengths[message.orders[at]], getattr(message, f"_{name}_raw", None)
            left -= WIDTHS[message.fieldtypes[at]] * max(count, 1)
            if left >= 0:  # MAVLink 1 has not the fields of MAVLink 2
                peer.leaves(topic, name, getattr(message, name) if raw is None else zero_ended(raw))
        topic.messages += 1


def decoded(log, frame, head):
    """The frame, or what its sender made it of, from which a ground station took the zeros at the end of the payload."""
    try:
        return log.decode(bytearray(frame))
    except all_messages.MAVError:
        definition = all_messages.mavlink_map.get(int.from_bytes(frame[7:10], "little"))
        left_out = range(1, definition.unpacker.size - frame[1] + 1) if head == 12 and definition else ()
        for zeros in left_out:
            with contextlib.suppress(all_messages.MAVError):
                end = 10 + frame[1]
                return log.decode(bytearray([frame[0], frame[1] + zeros, *frame[2:end], *bytes(zeros), *frame[end:]]))
        raise


WIDTHS = {f"{sign}int{bits}_t": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)}
WIDTHS |= {"char": 1, "float": 4, "double": 8, "uint8_t_mavlink_version": 1}


def read_ubx(path, peer):
    """Frames, sentences and corrections; values as they were before pyubx2 scaled them."""
    with open(path, "rb") as file:
        for raw, _ in pyubx2.UBXReader(file, protfilter=7, quitonerror=0, parsing=0):
            if raw[:1] == b"$":
                sentence(raw[1:-5].decode("latin"), pynmeagps.NMEAReader.parse(raw), peer)
            elif raw[:1] == b"\xd3":
                peer.topics[("RTCM3", "RTCM3")].messages += pyrtcm.calc_crc24q(raw) == 0
            elif pyubx2.calc_checksum(raw[2:-2]) == raw[-2:]:
                frame(raw, peer)


def frame(raw, peer):
    class_name = pyubx2.UBX_CLASSES.get(raw[2:3], "DBG").replace("DBG", f"0x{raw[2]:02X}")  # DBG is no name of u-blox
    name = f"{class_name}-0x{raw[3]:02X}"
    known = pyubx2.UBX_MSGIDS.get(raw[2:4], "")
    topic = peer.topics[(known, known) if known in UBX_READ else (name, name)]
    if known in UBX_READ and len(raw) > 8:
        message = pyubx2.UBXReader.parse(raw, parsebitfield=0)
        for field, kind in pyubx2.UBX_PAYLOADS_GET[message.identity].items():
            kind, scale = kind if isinstance(kind, tuple) and not isinstance(kind[1], dict) else (kind, 1)
            field = field.removesuffix("_bit")
            value = getattr(message, field, None)
            if isinstance(value, bytes):
                value = int.from_bytes(value, "little")
            if value is not None and not field.startswith("reserved") and not is_beyond(known, field):
                topic.add(UBX_NAMES.get(field, field), round(value / scale))
    topic.messages += 1


UBX_NAMES = {"second": "sec", "refinfo": "refInfo", "validflags": "valid"}
# Fields at the end of messages that later protocols added: ours leave them.
UBX_NEWER = {(pvt, name) for pvt in ("NAV-PVT", "NAV2-PVT") for name in ("flags3", "headVeh", "magDec", "magAcc")}
# pyubx2 adds up the digits of NAV-HPPOSLLH and NAV-HPPOSECEF; these are not compared.
UBX_PRECISE = set("lon lat height hMSL lonHp latHp heightHp hMSLHp latitude longitude ellipsoid_height".split())
UBX_PRECISE |= {f"{front}ecef{axis}{back}" for axis in "XYZ" for front, back in (("", ""), ("", "Hp"), ("_HP", ""))}


# Fields at the end of messages that pymavlink 2.4.50 does not know yet.
MAVLINK_NEWER = {("MISSION_CURRENT", f) for f in ("mission_id", "fence_id", "rally_points_id")}
MAVLINK_NEWER |= {(m, f) for m in ("TIMESYNC", "SERIAL_CONTROL") for f in ("target_system", "target_component")}
MAVLINK_NEWER |= {("SET_ATTITUDE_TARGET", f"thrust_body[{i}]") for i in range(3)}
MAVLINK_NEWER |= {(m, "opaque_id") for m in ("MISSION_COUNT", "MISSION_ACK")}
MAVLINK_NEWER |= {("WIFI_CONFIG_AP", f) for f in ("mode", "response")}


def is_beyond(message, field):
    return (message, field) in UBX_NEWER | MAVLINK_NEWER or (message in ("NAV-HPPOSLLH", "NAV-HPPOSECEF") and field in UBX_PRECISE)


UBX_READ = {f"NAV-{m}" for m in "PVT POSECEF POSLLH VELECEF VELNED HPPOSLLH SOL ATT STATUS DOP TIMEGPS TIMEUTC".split()}
UBX_READ |= {"NAV-PVAT", "NAV-HPPOSECEF", "NAV2-PVT", "ESF-INS", "HNR-PVT", "HNR-INS", "HNR-ATT", "TIM-TP", "TIM-TM2"}


def read_nmea(path, peer):
    """Every sentence whose checksum pynmeagps finds right. Its own walk through a file takes those without one too, and
    comments, and leaves talkers that it does not know."""
    lines = b"\n".join(line for line in path.read_bytes().split(b"\n") if not line.startswith(b"#"))
    for found in re.finditer(rb"[$!]([A-Z0-9]{3}[^*$\r\n]*)\*([0-9A-Fa-f]{2})(?=\s|$)", lines):
        body, told = (part.decode("latin") for part in found.groups())
        if len(body) > 510 or not body.isprintable() or pynmeagps.calc_checksum(body) != told.upper():
            continue
        try:
            message = pynmeagps.NMEAReader.parse(found.group(0) + b"\r\n")
        except Exception:
            message = None
        sentence(body, message, peer)


# Of a sentence the field of each value: a number, (the letter that makes it 1), or (deg,) with its hemisphere behind.
SENTENCES = {
    "GGA": {"latitude": ("deg", 2), "longitude": ("deg", 4), "quality": 6, "satellites": 7, "hdop": 8, "altitude": 9,
            "separation": 11, "age": 13},
    "GNS": {"latitude": ("deg", 2), "longitude": ("deg", 4), "valid": ("mode", 6), "satellites": 7, "hdop": 8,
            "altitude": 9, "separation": 10, "age": 11},
    "RMC": {"valid": ("A", 2), "latitude": ("deg", 3), "longitude": ("deg", 5), "speed": 7, "track": 8},
    "GLL": {"latitude": ("deg", 1), "longitude": ("deg", 3), "valid": ("A", 6)},
    "VTG": {"track": 1, "speed": 5, "valid": ("mode", 9)},
    "ZDA": {"day": 2, "month": 3, "year": 4},
    "HDT": {"heading": 1},
    "GST": {"latitude_std": 6, "longitude_std": 7, "altitude_std": 8},
    "PUBX,00": {"latitude": ("deg", 3), "longitude": ("deg", 5), "height": 7, "horizontal_accuracy": 9,
                "vertical_accuracy": 10, "speed_kmh": 11, "track": 12, "down": 13, "age": 14, "hdop": 15, "satellites": 18},
    "PUBX,04": {"utc_tow": 4, "utc_week": 5},
    "PTNL,GGK": {"latitude": ("deg", 4), "longitude": ("deg", 6), "quality": 8, "satellites": 9, "dop": 10},
    "PASHR": {"heading": 2, "roll": 4, "pitch": 5, "heave": 6, "roll_std": 7, "pitch_std": 8, "heading_std": 9},
}


def sentence(body, message, peer):
    fields = body.split(",")
    address = fields[0]
    if not re.fullmatch("[A-Z0-9]{3,}", address):
        address = re.match("P[A-Z0-9]{3}|$", address)[0]  # a text of its maker without a comma
    if not address:
        return
    if address in ("PUBX", "PTNL") and re.fullmatch("[A-Z0-9]{2,3}", ",".join(fields[1:2])):
        address += "," + fields[1]  # u-blox numbers its messages, Trimble names them
    kind = address if address.startswith("P") or len(address) != 5 else address[2:]
    values_of(fields, message, kind, peer.topics[(address, kind)])
    if kind != address:
        peer.joined[(kind, kind)].add("talker", address[:2])
        values_of(fields, message, kind, peer.joined[(kind, kind)])


def values_of(fields, message, kind, topic):
    of = lambda index: fields[index] if index < len(fields) else ""
    # PASHR stands in front of many messages; the one of attitudes begins with a time.
    values = {} if kind == "PASHR" and not re.fullmatch(r"[\d.]+", of(1)) else SENTENCES.get(kind, {})
    for name, where in values.items():
        what, index = where if isinstance(where, tuple) else (None, where)
        if what == "deg":
            fix = of(SENTENCES[kind].get("valid", ("", 6))[1]) not in ("0", "V") or kind == "GNS"
            if of(index) and of(index + 1) and (fix or re.match(r"(0?\d\d|1\d\d)[0-5]\d(\.|$)", of(index))):
                degrees, minutes = of(index).split(".")[0][:-2] or "0", of(index)[of(index).find(".") - 2:]
                sign = -1 if of(index + 1) in "SW" else 1
                topic.add(name, float(sign * (Fraction(degrees) + Fraction(minutes) / 60)))
                theirs = getattr(message, name[:3], None)
                assert not isinstance(theirs, float) or abs(theirs - topic.columns[name][1][-1]) < 1e-7, (fields, theirs)
        elif what == "mode":  # N is none, of each system
            topic.add(name, float(not re.fullmatch("N+", of(index))))
        elif what:
            topic.add(name, float(of(index) == what))
        elif of(index):
            topic.add(name, float(of(index)))
    if kind in ("GGA", "GNS"):
        altitude, separation = (of(SENTENCES[kind][name]) for name in ("altitude", "separation"))
        if altitude and separation:
            topic.add("height", float(altitude) + float(separation))
    if kind == "PTNL,GGK" and of(11).startswith("EHT"):
        topic.add("height", float(of(11)[3:]))
    if kind == "RMC" and of(2) == "A" and message and message.date and message.time:
        moment = datetime.combine(message.date, message.time, timezone.utc)
        topic.add("utc_ns", round(moment.timestamp() * 10**6) * 1000)
    topic.messages += 1


# Columns of NovAtel's messages as text by its OEM7 manual.
POSITION = "sol_status pos_type lat lon hgt undulation datum lat_sd lon_sd hgt_sd station diff_age sol_age svs soln_svs"
SOLUTION = "week seconds {} status"
INSPVA = "week seconds lat lon hgt north_vel east_vel up_vel roll pitch azimuth status"
NOVATEL = {"BESTPOS": POSITION, "PSRPOS": POSITION, "BESTGNSSPOS": POSITION, "INSPVA": INSPVA, "INSPVAS": INSPVA,
           "BESTVEL": "sol_status vel_type latency age hor_spd trk_gnd vert_spd",
           "INSPOS": SOLUTION.format("lat lon hgt"), "INSVEL": SOLUTION.format("north_vel east_vel up_vel"),
           "INSATT": SOLUTION.format("roll pitch azimuth")}


def read_novatel(path, peer):
    for line in path.read_text("ascii", "replace").splitlines():
        header, semicolon, rest = line.partition(";")
        body, star, _ = rest.rpartition("*")
        header, fields = header.split(","), next(iter(csv.reader([body], quotechar='"')), [])
        name = header[0][1:-1]
        if not (semicolon and star and line[0] in "#%"):
            continue
        topic = peer.topics[(name, f"novatel/{name}")]
        week = 1 if line[0] == "%" else 5
        names = NOVATEL.get(name, "").split()
        names += [f"field_{i + 1}" for i in range(len(names), len(fields))]
        for field, text in [*zip(("header.week", "header.seconds"), header[week:week + 2]), *zip(names, fields)]:
            if text:
                topic.add(field, text)
        topic.messages += 1
    for topic in peer.topics.values():
        for rows, cells in topic.columns.values():
            with contextlib.suppress(ValueError):  # a column of numbers, or of texts
                cells[:] = [float(cell) for cell in cells]


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


def unequal(ours, rows, values, my_order, their_order, partial):
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
    if partial:
        there = there & expected
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
    for key in peer.joined.keys() & (+ours.counts).keys():  # one receiver that changes its talker is one topic
        peer.topics = {other: topic for other, topic in peer.topics.items() if other[1] != key[1]} | {key: peer.joined[key]}
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
                wrong = unequal(columns.pop(name), at, cells, *orders, name in DERIVED)
                text = wrong and f"{key}.{name}: row {wrong[0]}: {wrong[1]!r}, the reader has {wrong[2]!r}"
            else:
                text = f"{key}.{name}: absent, the reader has {cells[0]!r}"
            differences += [text] * bool(text)
        if key not in peer.undecoded:
            said = {name for name, cells in columns.items() if any(cells if isinstance(cells, list) else cells[0])}
            alone = sorted(name for name in said - DERIVED if not is_beyond(key[1], name))
            differences += [f"{key}.{name}: a column that the reader does not have" for name in alone]
    why = next(iter(peer.undecoded.values()), "")
    notes = [f"{len(peer.undecoded)} topics by counts, first and last stamp only ({why[:80]})"] * bool(why)
    notes += [f"{peer.not_compared} fields of bytes or elements of long arrays not compared"] * bool(peer.not_compared)
    return values, notes, differences


# The reader, its modules, ends of the names of its logs, how it reads, whether it keeps the order of the file.
READERS = [
    ("pyulog", {"pyulog": "pyulog"}, (".ulg", ".ulg.zip"), read_ulog, True),
    ("pymavlink", {"dfreader": "pymavlink.DFReader"}, (".bin",), read_dataflash, True),
    ("pymavlink", {"all_messages": "pymavlink.dialects.v20.all"}, (".tlog", ".tlog.raw"), read_telemetry, True),
    ("pyubx2", {"pyubx2": "pyubx2", "pynmeagps": "pynmeagps", "pyrtcm": "pyrtcm"}, (".ubx",), read_ubx, True),
    ("pynmeagps", {"pynmeagps": "pynmeagps"}, (".nmea",), read_nmea, True),
    ("by hand", {}, (".novatel.txt",), read_novatel, True),
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
