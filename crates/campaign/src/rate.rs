//! Update rate of a channel.

use flight::ChannelHealth;

/// Rate of new values of a channel, Hz: of its updates if values are held, else of its rows.
pub(crate) fn rate_of(channels: &[ChannelHealth], name: &str) -> Option<f64> {
    let channel = channels.iter().find(|c| c.name == name)?;
    match &channel.held {
        Some(held) => (held.update_interval_s > 0.0).then(|| 1.0 / held.update_interval_s),
        None => channel.stamps.as_ref().and_then(|s| s.rate_hz),
    }
}
