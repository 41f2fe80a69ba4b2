//! Values for the design of a filter from one measured flight.

use crate::rate::rate_of;
use compensation_replay::{EkfChannelFacts, ekf_values};
use flight::Binding;
use record::{ChannelLateness, EkfValues, MeasuredFlight, NetworkDatum, NetworkVerdict};
use std::collections::BTreeMap;

/// Noise, wander and delay of each compared channel. Rates come from the log, latenesses from the network. `None` for a
/// flight without measured delays.
pub(crate) fn of(measured: &MeasuredFlight, binding: &Binding) -> Option<EkfValues> {
    let delays = measured.delays.as_ref()?;
    // If pairs contradict each other and the wrong one is unknown, no single number is right.
    let decided = measured.network.iter().filter(|n| n.verdict != NetworkVerdict::Undecided);
    let channels = decided.flat_map(|n| &n.channels);
    // The zero of a network has no lateness.
    let known = channels.filter(|c| c.relative_to.as_ref() != Some(&c.channel));
    let lateness: BTreeMap<&str, &ChannelLateness> = known.map(|c| (c.channel.as_str(), c)).collect();
    let facts = |name: &str| EkfChannelFacts {
        rate_hz: rate_of(&binding.channels, name),
        lateness_s: lateness.get(name).map(|c| (c.lateness_s, against(c))),
    };
    let names = delays.pairs.iter().map(|pair| pair.first.as_str());
    Some(ekf_values(delays, &names.map(|name| (name.to_owned(), facts(name))).collect()))
}

/// Datum of the lateness of a channel, such as `the IMU`.
fn against(channel: &ChannelLateness) -> String {
    match (&channel.relative_to, channel.datum) {
        (Some(zero), _) => zero.clone(),
        (None, NetworkDatum::Reference) => "the reference".to_owned(),
        (None, _) => "the IMU".to_owned(),
    }
}
