#!/usr/bin/env python3
"""Reading what a delay needs of one simulated flight in every format, and of one with a camera and a laser scanner beside
it, against the least that it can cost and against the Python readers that are installed. The least is told in CPU seconds
(user + system) of whole processes with one thread, one after the other in each round, their ratios round by round; Python in
wall seconds end to end, ours with all cores. Needs: cargo build --release -p flightlag-ingest -p flightlag-simulate --examples"""

import os, re, resource, struct, subprocess, sys, tempfile, time

ROUNDS = int(os.environ.get("ROUNDS", "7"))
BIN = os.path.join(os.environ.get("CARGO_TARGET_DIR", "target"), "release", "examples")
PEERS = {
    "mcap": ("import sys\nfrom mcap.reader import make_reader\nfrom mcap_ros2.decoder import DecoderFactory\n"
             "r=make_reader(open(sys.argv[1],'rb'),decoder_factories=[DecoderFactory()])\n"
             "n=sum(1 for _ in r.iter_decoded_messages(topics=sys.argv[2:]))"),
    "bag": ("import sys\nfrom pathlib import Path\nfrom rosbags.highlevel import AnyReader\n"
            "with AnyReader([Path(sys.argv[1])]) as r:\n"
            "    c=[x for x in r.connections if x.topic in sys.argv[2:]]\n"
            "    n=sum(1 for k,t,d in r.messages(connections=c) if r.deserialize(d,k.msgtype) is not None)"),
    "ulog": "import sys\nfrom pyulog import ULog\nULog(sys.argv[1], sys.argv[2:])",
    "dataflash": ("import sys\nfrom pymavlink import DFReader\nr=DFReader.DFReader_binary(sys.argv[1])\n"
                  "n=0\nwhile True:\n    m=r.recv_match(type=sys.argv[2:])\n    if m is None: break\n    n+=1"),
    "csv": "import sys\nimport pandas\npandas.read_csv(sys.argv[1], skiprows=[1], usecols=[0,1,2,3,4,5])",
}
ROS = {"/gps/fix": "latitude,longitude,altitude,header.stamp",
       "/gps/vel": "twist.linear.x,twist.linear.y,twist.linear.z,header.stamp"}
WANTED = {
    "mcap": ROS, "bag": ROS, "db3": ROS,
    "ulog": {"vehicle_gps_position": "timestamp,latitude_deg,longitude_deg,altitude_msl_m,vel_n_m_s,vel_e_m_s,vel_d_m_s"},
    "dataflash": {"GPS": "TimeUS,Lat,Lng,Alt", "XKF1": "TimeUS,VN,VE,VD"},
    "csv": {"csv": "time_ns,latitude,longitude,velocity_north,velocity_east,velocity_down"},
}


def timed(command, threads=None):
    """CPU and wall seconds, and what it said."""
    environment = dict(os.environ, RAYON_NUM_THREADS=str(threads)) if threads else None
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "failed")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, done.stdout


def median(values):
    return sorted(values)[len(values) // 2]


def size(path):
    if os.path.isfile(path):
        return os.path.getsize(path)
    return sum(os.path.getsize(os.path.join(d, f)) for d, _, files in os.walk(path) for f in files)


def chunks_with(path, topics):
    """Bytes of the chunks of an MCAP that hold messages of these topics."""
    channels, indexed = set(), []
    with open(path, "rb") as log:
        at, end = 8, os.path.getsize(path) - 8
        while at < end:
            log.seek(at)
            opcode, length = struct.unpack("<BQ", log.read(9))
            if opcode == 6:
                indexed.append((length + 9, set()))
            elif opcode == 7:
                indexed[-1][1].add(*struct.unpack("<H", log.read(2)))
            elif opcode == 4:
                number, _, size = struct.unpack("<HHI", log.read(8))
                channels |= {number} if log.read(size).decode() in topics else set()
            at += 9 + length
    return sum(size for size, held in indexed if held & channels)


def limit_of(name, path, ours, wanted):
    if name.endswith("split"):
        return [ours[0], path.replace("split", "zstd")] + ours[2:]
    if "db3" in name:
        inner = next(os.path.join(path, f) for f in sorted(os.listdir(path)) if f.endswith(".db3"))
        return [os.path.join(BIN, "db3_stepping"), inner, *wanted]
    return [os.path.join(BIN, "decompress_only"), path] + (["read"] if name.endswith("none") else [])


def row(name, path):
    kind = name.removeprefix("camera-")
    wanted = WANTED[kind.split("-")[0]]
    ours = [os.path.join(BIN, "read_topics"), path] + [f"{topic}={fields}" for topic, fields in wanted.items()]
    limit = limit_of(kind, path, ours, wanted)
    family = "bag" if kind == "db3" else kind.split("-")[0]
    peer = [sys.executable, "-c", PEERS[family], path, *wanted] if family in PEERS else None
    times, limits, walls, peers = [], [], [], []
    out, problem = "", ""
    for round in range(ROUNDS + 1):
        low = timed(limit, 1)[0]
        high = timed(ours, 1)[0]
        _, wall, out = timed(ours)
        if round:  # the first warms the page cache
            times.append(high), limits.append(low), walls.append(wall)
    try:
        peers = [timed(peer)[1]] if peer else []
    except RuntimeError as e:
        problem = str(e)[:40]
    ratios = [a / b for a, b in zip(times, limits)]
    megabytes = size(path) / 1e6
    read, memory = re.search(r"(\d+) bytes read, peak memory (\d+) kB", out).groups()
    python = f"{min(peers) / median(walls):6.0f} x" if peers else f"  {problem or '-'}"
    print(f"{name:17} {megabytes:7.1f} {median(times):8.3f} {megabytes / median(times):8.0f} {median(walls):8.3f} {median(limits):8.3f} "
          f"{median(ratios):6.2f} [{min(ratios):.2f} to {max(ratios):.2f}] {int(read) / 1e6:8.1f} "
          f"{int(memory) / 1024:8.1f} {python}", flush=True)
    if kind.endswith("split"):
        needed = chunks_with(path, wanted)
        print(f"{'':17} of {needed / 1e6:.1f} MB of chunks that hold wanted topics: {int(read) / needed:.3f}")


FORMATS = ["mcap-zstd", "mcap-lz4", "mcap-none", "mcap-split", "bag-lz4", "bag-none", "bag-bz2", "db3", "ulog", "dataflash",
           "csv"]


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="flightlag-perf-")
    if not os.path.exists(os.path.join(folder, "camera-mcap-split.mcap")):
        subprocess.run([os.path.join(BIN, "perf_logs"), folder, os.environ.get("SECONDS_FLOWN", "900")], check=True)
    files = {f.split(".")[0]: os.path.join(folder, f) for f in sorted(os.listdir(folder))}
    print(f"{'log':17} {'MB':>7} {'CPU s':>8} {'MB/s':>8} {'wall s':>8} {'limit s':>8}  ratio [least to most]  MB read  peak MiB  Python / ours")
    for name in FORMATS + [f"camera-{format}" for format in FORMATS]:
        if name in files:
            row(name, files[name])
    print("limit: the file read (none, ULog, DataFlash, CSV); every chunk decompressed and checksums of chunks and LZ4 frames\n"
          "checked (zstd, lz4, bz2); SQLite stepping through the wanted rows (db3); the same topics out of camera-mcap-zstd (split)")


main()
