//! Hand-made records of the binary formats.

/// A text in a field of a fixed size.
pub fn padded(text: &str, size: usize) -> Vec<u8> {
    [text.as_bytes(), &vec![0; size - text.len()]].concat()
}

/// Bytes of a DataFlash record.
pub fn dataflash_size(codes: &str) -> u8 {
    let size = |code| match code {
        'b' | 'B' | 'M' => 1,
        'c' | 'C' | 'h' | 'H' | 'g' => 2,
        'e' | 'E' | 'i' | 'I' | 'L' | 'f' | 'n' => 4,
        'q' | 'Q' | 'd' => 8,
        'N' => 16,
        _ => 64,
    };
    3 + codes.chars().map(size).sum::<u8>()
}

/// The definition of a DataFlash type.
pub fn dataflash_fmt(id: u8, name: &str, codes: &str, columns: &str) -> Vec<u8> {
    dataflash_fmt_of(id, dataflash_size(codes), name, codes, columns)
}

/// As [`dataflash_fmt`], with this stated record length.
pub fn dataflash_fmt_of(id: u8, length: u8, name: &str, codes: &str, columns: &str) -> Vec<u8> {
    [vec![0xa3, 0x95, 128, id, length], padded(name, 4), padded(codes, 16), padded(columns, 64)].concat()
}

/// The start of a DataFlash log.
pub fn dataflash_begin() -> Vec<u8> {
    dataflash_fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
}

/// A DataFlash record.
pub fn dataflash_record(id: u8, body: &[u8]) -> Vec<u8> {
    [&[0xa3, 0x95, id], body].concat()
}

/// A message of a ULog.
pub fn ulog_message(kind: u8, body: &[u8]) -> Vec<u8> {
    [&(body.len() as u16).to_le_bytes()[..], &[kind], body].concat()
}

/// The start of a ULog with these topics, numbered in their order: format, instance.
pub fn ulog_begin(topics: &[(&str, u8)]) -> Vec<u8> {
    let mut out = b"ULog\x01\x12\x35\x01\x00\x00\x00\x00\x00\x00\x00\x00".to_vec();
    out.extend(ulog_message(b'B', &[0; 40]));
    topics.iter().for_each(|(format, _)| out.extend(ulog_message(b'F', format.as_bytes())));
    for (number, (format, instance)) in topics.iter().enumerate() {
        let name = format.split(':').next().unwrap().as_bytes();
        out.extend(ulog_message(b'A', &[&[*instance, number as u8, 0], name].concat()));
    }
    out
}

/// A UBX frame.
pub fn ubx_frame(class: u8, number: u8, payload: &[u8]) -> Vec<u8> {
    let body = [&[class, number][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
    let sum = |[a, b]: [u8; 2], byte: &u8| [a.wrapping_add(*byte), b.wrapping_add(a.wrapping_add(*byte))];
    [&[0xb5, 0x62], &body[..], &body.iter().fold([0_u8; 2], sum)].concat()
}

/// A MAVLink 2 frame of vehicle 1 in a tlog; `extra` is the CRC_EXTRA of the message.
pub fn tlog_frame(time_us: u64, number: u32, extra: u8, payload: &[u8]) -> Vec<u8> {
    tlog_frame_from([1, 1], 0, time_us, number, extra, payload)
}

/// CRC-16/MCRF4XX of a frame's bytes and its CRC_EXTRA.
pub fn crc16(bytes: &[u8]) -> u16 {
    let step = |crc: u16, byte: &u8| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 })
    };
    bytes.iter().fold(0xffff, step)
}

/// As [`tlog_frame`], from this system and component, with these flags.
pub fn tlog_frame_from(sender: [u8; 2], flags: u8, time_us: u64, number: u32, extra: u8, payload: &[u8]) -> Vec<u8> {
    let ([system, component], [a, b, c, _]) = (sender, number.to_le_bytes());
    let body = [&[payload.len() as u8, flags, 0, 0, system, component, a, b, c], payload].concat();
    let crc = crc16(&[&body[..], &[extra]].concat());
    [&time_us.to_be_bytes()[..], &[0xfd], &body, &crc.to_le_bytes()].concat()
}
