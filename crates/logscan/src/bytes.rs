//! Tests on the content of a byte slice.

/// Whether all bytes are zero. Compared block by block, which the processor does fast.
#[must_use]
pub fn is_zero(bytes: &[u8]) -> bool {
    const ZEROS: [u8; 4096] = [0; 4096];
    bytes.chunks(ZEROS.len()).all(|chunk| ZEROS.starts_with(chunk))
}

/// Whether the bytes are text without control characters.
#[must_use]
pub fn is_plain(text: &[u8]) -> bool {
    std::str::from_utf8(text).is_ok_and(|text| text.bytes().all(|b| b >= b' ' || b"\t\r\n".contains(&b)))
}
