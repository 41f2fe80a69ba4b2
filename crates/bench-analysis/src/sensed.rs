//! A channel before its analysis, and data shared by all channels.

use crate::clock::ChannelTime;
use crate::gap::Hidden;
use crate::reference_error::{ReferenceErrors, Sensitivity};
use crate::sampling::rate_hz;
use flight::Channel;
use record::TimeBasis;
use signal::{DelaySettings, Gain, Measurement, Reference, Sign};

/// One component of a channel with its expected values.
pub(crate) struct SensedComponent<'a> {
    pub(crate) name: &'a str,
    pub(crate) unit: &'a str,
    /// One value for each row of the channel.
    pub(crate) values: &'a [f64],
    pub(crate) reference: &'a dyn Reference,
    /// Standard uncertainty of the reference at any one instant.
    pub(crate) reference_std: f64,
    /// Dependence of the reference on the bar.
    pub(crate) sensitivity: Sensitivity<'a>,
    /// `Err` with the reason if the swing does not move it enough to count.
    pub(crate) excited: Result<(), &'a str>,
    /// Whether its offset may drift.
    pub(crate) drift: bool,
}

/// A channel before its analysis.
pub(crate) struct SensedChannel<'a> {
    pub(crate) name: &'a str,
    /// With timestamps in the encoder's clock.
    pub(crate) channel: &'a Channel,
    /// Its timestamps, s after the origin.
    pub(crate) t: Vec<f64>,
    pub(crate) time: &'a ChannelTime,
    /// Timestamps whose true instant is in a gap of the encoder.
    pub(crate) hidden: Hidden<'a>,
    pub(crate) components: Vec<SensedComponent<'a>>,
}

/// Data shared by all channels.
pub(crate) struct Circumstances<'a> {
    pub(crate) basis: &'a TimeBasis,
    /// Standard uncertainty of the anchor's own lag, s; zero where delays are absolute.
    pub(crate) anchor_s: f64,
    pub(crate) search_s: (f64, f64),
    /// Margin of the equivalence test, s, if set in the rig file.
    pub(crate) margin_s: Option<f64>,
    pub(crate) inject_s: &'a [f64],
    pub(crate) inject_gain: f64,
    /// Encoder timestamps, s, and rate of the bar, rad/s.
    pub(crate) t: &'a [f64],
    pub(crate) rate: &'a [f64],
    /// Enlarged segment, s.
    pub(crate) zoom: (f64, f64),
    /// Mean period of the bar's angle, s; zero if it does not swing.
    pub(crate) period_s: f64,
    /// Bar rates below this count as rest, rad/s.
    pub(crate) still_rate: f64,
    /// Effect of the encoder's steps on the references.
    pub(crate) errors: &'a ReferenceErrors,
    /// Why no channel gets a verdict, if the gate is closed.
    pub(crate) closed: Option<String>,
}

impl Circumstances<'_> {
    pub(crate) fn settings(&self) -> DelaySettings {
        DelaySettings { search_s: self.search_s, ..DelaySettings::default() }
    }
}

/// Timestamps and values of the rows that are updates, without held repeats.
pub(crate) struct Updates {
    pub(crate) t: Vec<f64>,
    /// Components of the channel, excited or not.
    pub(crate) values: Vec<Vec<f64>>,
    /// Indices of the components used in the fit.
    pub(crate) excited: Vec<usize>,
    pub(crate) rows: usize,
    /// Updates rejected because the encoder has a gap at their instant.
    pub(crate) hidden: Vec<usize>,
    /// Mean age of the held value over all rows, s.
    pub(crate) mean_age_s: Option<f64>,
    /// Median step between rows, s.
    pub(crate) row_step_s: Option<f64>,
}

impl Updates {
    pub(crate) fn of(channel: &SensedChannel<'_>) -> Updates {
        let hides = |row: &usize| channel.t.get(*row).is_some_and(|t| channel.hidden.hides(*t));
        let updates = channel.channel.update_rows();
        let held = channel.channel.is_held();
        // A loop also reads what came during a gap of the encoder.
        let mean_age_s = held.then(|| mean_age(&channel.t, &updates)).flatten();
        let (hidden, rows): (Vec<usize>, Vec<usize>) = updates.into_iter().partition(hides);
        let pick = |values: &[f64]| rows.iter().filter_map(|&row| values.get(row).copied()).collect::<Vec<f64>>();
        let excited =
            channel.components.iter().enumerate().filter(|(_, c)| c.excited.is_ok()).map(|(k, _)| k).collect();
        Updates {
            t: pick(&channel.t),
            values: channel.components.iter().map(|c| pick(c.values)).collect(),
            excited,
            rows: channel.t.len(),
            hidden,
            mean_age_s,
            row_step_s: signal::median_step(&channel.t),
        }
    }

    pub(crate) fn measurements<'m>(&'m self, channel: &'m SensedChannel<'_>) -> Vec<Measurement<'m>> {
        self.excited.iter().map(|&k| measurement(&channel.components[k], &self.t, &self.values[k])).collect()
    }

    /// Uncertainty of the references of the components in the fit.
    pub(crate) fn reference_std(&self, channel: &SensedChannel<'_>) -> Vec<f64> {
        self.excited.iter().map(|&k| channel.components[k].reference_std).collect()
    }

    pub(crate) fn sensitivities<'m>(&self, channel: &'m SensedChannel<'_>) -> Vec<Sensitivity<'m>> {
        self.excited.iter().map(|&k| channel.components[k].sensitivity).collect()
    }

    pub(crate) fn rate_hz(&self) -> Option<f64> {
        rate_hz(&self.t)
    }
}

pub(crate) fn measurement<'m>(component: &SensedComponent<'m>, t: &'m [f64], y: &'m [f64]) -> Measurement<'m> {
    Measurement {
        t,
        y,
        reference: component.reference,
        gain: Gain::Free { sign: Sign::Positive },
        drift: component.drift,
    }
}

/// An age above this many usual intervals between updates is an outage, and not a property of the sensor.
const OUTAGE_INTERVALS: f64 = 2.5;

/// Mean over all rows of the age of the repeated update, s, without outages.
fn mean_age(t: &[f64], updates: &[usize]) -> Option<f64> {
    let first = *updates.first()?;
    let instants: Vec<f64> = updates.iter().filter_map(|&row| t.get(row).copied()).collect();
    let longest_s = signal::median_step(&instants).map_or(f64::INFINITY, |usual| OUTAGE_INTERVALS * usual);
    let mut newest = first;
    let mut next = updates.iter().copied().peekable();
    let (mut sum, mut rows) = (0.0, 0_u32);
    for row in first..t.len() {
        if next.peek() == Some(&row) {
            newest = row;
            next.next();
        }
        let age_s = t[row] - t[newest];
        if age_s <= longest_s {
            sum += age_s;
            rows += 1;
        }
    }
    Some(sum / f64::from(rows))
}

#[cfg(test)]
mod tests {
    use super::mean_age;

    /// Updates every 4 rows of 10 ms: ages of 0, 10, 20 and 30 ms.
    #[test]
    fn the_mean_age_of_a_held_value_is_over_all_rows() {
        let t: Vec<f64> = (0..40).map(|k| 0.01 * f64::from(k)).collect();
        let updates: Vec<usize> = (0..40).step_by(4).collect();
        assert!((mean_age(&t, &updates).unwrap() - 0.015).abs() < 1e-12);
        assert_eq!(mean_age(&t, &[]), None);
        // Former bug: a receiver that stopped for the second half was "as seen" as late as the outage was long. Of the last
        // update, ages of up to 2.5 intervals count: 11 rows from 0 to 100 ms.
        let stopped: Vec<usize> = (0..20).step_by(4).collect();
        let of_four_updates = 4.0 * 0.06;
        let of_the_last = 0.01 * 55.0;
        let expected = (of_four_updates + of_the_last) / (16.0 + 11.0);
        assert!((mean_age(&t, &stopped).unwrap() - expected).abs() < 1e-12);
    }
}
