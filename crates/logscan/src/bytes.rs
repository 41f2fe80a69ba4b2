//! What kind of bytes a slice holds.

/// Whether all bytes are zero: compared in pieces, which a processor does at once.
#[must_use]
pub fn is_zero(bytes: &[u8]) -> bool {
    const ZEROS: [u8; 4096] = [0; 4096];
    bytes.chunks(ZEROS.len()).all(|chunk| ZEROS.starts_with(chunk))
}

/// Whether it is text without control characters.
#[must_use]
pub fn is_plain(text: &[u8]) -> bool {
    std::str::from_utf8(text).is_ok_and(|text| text.bytes().all(|b| b >= b' ' || b"\t\r\n".contains(&b)))
}
