//! Identity and configuration of the receiver: UBX-MON-VER, SEC-UNIQID, CFG-RATE, CFG-PRT.

use crate::decode::packed::text_of;
use crate::format::identity::of_version;
use flight::ReceiverIdentity;

/// Information from the messages so far; the first message of each type counts.
#[derive(Debug, Default)]
pub(super) struct Identity {
    lines: Vec<String>,
    serial: Option<String>,
    rate_hz: Option<f64>,
    baud: Option<u32>,
}

impl Identity {
    /// Takes a message of this class and number.
    pub(super) fn observe(&mut self, key: (u8, u8), payload: &[u8]) {
        match key {
            (0x0a, 0x04) if self.lines.is_empty() => self.lines = version_lines(payload),
            (0x27, 0x03) if self.serial.is_none() => self.serial = unique_number(payload),
            (0x06, 0x08) if self.rate_hz.is_none() => self.rate_hz = fix_rate(payload),
            (0x06, 0x00) if self.baud.is_none() => self.baud = line_speed(payload),
            _ => {}
        }
    }

    pub(super) fn finish(self) -> Vec<ReceiverIdentity> {
        let fresh = || ReceiverIdentity { number: 1, ..ReceiverIdentity::default() };
        let mut receiver = of_version(&self.lines, "MON-VER", "UBX").unwrap_or_else(fresh);
        let facts = [
            ("serial", "SEC-UNIQID", self.serial.is_some()),
            ("rate", "CFG-RATE", self.rate_hz.is_some()),
            ("baud", "CFG-PRT", self.baud.is_some()),
        ];
        let known = facts.into_iter().filter(|(.., known)| *known);
        receiver.sources.extend(known.map(|(name, source, _)| (name.to_owned(), source.to_owned())));
        (receiver.serial, receiver.rate_hz, receiver.baud) = (self.serial, self.rate_hz, self.baud);
        if receiver.is_told() { vec![receiver] } else { vec![] }
    }
}

/// Software, 30 bytes; hardware, 10; and 30 for each further line.
fn version_lines(payload: &[u8]) -> Vec<String> {
    let (software, rest) = payload.split_at_checked(30).unwrap_or((payload, &[]));
    let (hardware, more) = rest.split_at_checked(10).unwrap_or((rest, &[]));
    let first = [("SW", software), ("HW", hardware)].map(|(name, text)| (name, text_of(text)));
    let first = first.into_iter().filter(|(_, text)| !text.is_empty()).map(|(name, text)| format!("{name} {text}"));
    first.chain(more.chunks(30).map(|line| text_of(line).into_owned()).filter(|line| !line.is_empty())).collect()
}

/// Version 1 has five bytes, version 2 six.
fn unique_number(payload: &[u8]) -> Option<String> {
    let number = payload.get(4..).filter(|number| (5..=6).contains(&number.len()))?;
    number.iter().any(|byte| *byte != 0).then(|| number.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Fixes per second, from the measurement period, ms, times the measurements per fix.
fn fix_rate(payload: &[u8]) -> Option<f64> {
    let number = |at: usize| Some(f64::from(u16::from_le_bytes(*payload.get(at..)?.first_chunk()?)));
    let period_ms = number(0)? * number(2)?;
    (payload.len() == 6 && period_ms > 0.0).then(|| 1e3 / period_ms)
}

/// Baud rate of the first serial port.
fn line_speed(payload: &[u8]) -> Option<u32> {
    const UART_1: u8 = 1;
    let baud = u32::from_le_bytes(*payload.get(8..)?.first_chunk()?);
    (payload.len() == 20 && payload.first() == Some(&UART_1) && baud > 0).then_some(baud)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(text: &str, size: usize) -> Vec<u8> {
        let mut field = text.as_bytes().to_vec();
        field.resize(size, 0);
        field
    }

    #[test]
    fn identity_and_configuration_are_read_from_the_messages() {
        let mut identity = Identity::default();
        let version = [field("EXT CORE 3.01 (107900)", 30), field("00080000", 10), field("MOD=NEO-M8N-0", 30)].concat();
        identity.observe((0x0a, 0x04), &version);
        identity.observe((0x27, 0x03), &[1, 0, 0, 0, 0xd0, 1, 2, 3, 4]);
        identity.observe((0x06, 0x08), &[100, 0, 2, 0, 1, 0]);
        let port = [&[1, 0, 0, 0][..], &[0; 4], &115_200_u32.to_le_bytes(), &[0; 8]].concat();
        identity.observe((0x06, 0x00), &port);
        let [receiver] = &identity.finish()[..] else { panic!() };
        assert_eq!(receiver.model.as_deref(), Some("NEO-M8N-0"));
        assert_eq!(receiver.firmware.as_deref(), Some("EXT CORE 3.01 (107900)"));
        assert_eq!(
            (receiver.serial.as_deref(), receiver.rate_hz, receiver.baud),
            (Some("d001020304"), Some(5.0), Some(115_200))
        );
        assert_eq!(receiver.sources["serial"], "SEC-UNIQID");
    }

    #[test]
    fn truncated_and_empty_messages_give_no_identity() {
        let mut identity = Identity::default();
        for key in [(0x0a, 0x04), (0x27, 0x03), (0x06, 0x08), (0x06, 0x00)] {
            for length in 0..40 {
                identity.observe(key, &vec![0; length]);
            }
        }
        assert_eq!(identity.finish(), []);
    }
}
