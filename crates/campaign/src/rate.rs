//! How fast a channel is.

use flight::ChannelHealth;

/// How often a channel brings news, Hz: its updates where values are held, else its rows.
pub(crate) fn rate_of(channels: &[ChannelHealth], name: &str) -> Option<f64> {
    let channel = channels.iter().find(|c| c.name == name)?;
    match &channel.held {
        Some(held) => (held.update_interval_s > 0.0).then(|| 1.0 / held.update_interval_s),
        None => channel.stamps.as_ref().and_then(|s| s.rate_hz),
    }
}
