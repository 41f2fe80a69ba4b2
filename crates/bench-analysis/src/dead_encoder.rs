//! An encoder that dies: its count is constant while the sensor moves with the bar.

use crate::encoder::EncoderSeries;
use flight::{Channel, Clock, Code, Flight, Quantity, RejectCount, Stamp, fixed};
use record::GateCheck;

/// Shortest constant part that is checked, s: at each reversal the count is constant for a moment.
const SHORTEST_S: f64 = 3.0;
/// Seconds at the edges of a part that are not compared: a channel may be late.
const EDGE_S: f64 = 1.0;
/// A sensor at rest moves less than this share of what it moves otherwise.
const REST: f64 = 0.3;
/// Fewest samples of a channel in a part.
const LEAST_ROWS: usize = 8;

/// Without the parts in which the count is constant while a gyro or a velocity of `sensor`, on the encoder's `clock`,
/// moves as elsewhere, and a failed check that names them. The smoother would turn them into a bar at rest.
pub(crate) fn without_dead_parts(
    mut series: EncoderSeries,
    sensor: &Flight,
    clock: Clock,
) -> (EncoderSeries, Option<GateCheck>) {
    let mut texts = vec![];
    let movers: Vec<Mover> =
        sensor.channels.iter().filter_map(|(n, c)| Mover::of(n, c, clock, series.origin)).collect();
    let parts = constant_parts(&series);
    let spans: Vec<(f64, f64)> = parts.iter().map(|p| (series.t_s[p.start], series.t_s[p.end - 1])).collect();
    let mut kept = vec![true; series.t_s.len()];
    for (part, &(from_s, to_s)) in parts.iter().zip(&spans) {
        let Some(mover) = movers.iter().find(|m| m.moves_in((from_s, to_s), &spans)) else { continue };
        // Its first reading is real.
        kept[part.start + 1..part.end].fill(false);
        let [from, to] = [from_s, to_s].map(|s| fixed(s, 2));
        let text = format!(
            "the encoder's count is constant from {from} to {to} s while {} moves: this part is not used",
            mover.name
        );
        let rows = (part.len() - 1) as u64;
        series.notices.push(Code::EncoderRepaired, &series.channel, rows, text.clone());
        texts.push(text);
        series.rejected.push(RejectCount {
            reason: "constant while the sensor moves".to_owned(),
            count: rows,
            first: format!("{from} s"),
        });
    }
    let pick = |values: &[f64]| values.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(v, _)| *v).collect();
    (series.t_s, series.angle_rad) = (pick(&series.t_s), pick(&series.angle_rad));
    (series, check_of(&texts))
}

/// The dead parts as a check that failed; `None` without one.
fn check_of(texts: &[String]) -> Option<GateCheck> {
    let name = || "encoder alive".to_owned();
    (!texts.is_empty()).then(|| GateCheck { name: name(), passed: false, text: texts.join("; ") })
}

/// Runs of equal readings.
fn constant_parts(series: &EncoderSeries) -> Vec<std::ops::Range<usize>> {
    let mut parts = vec![];
    let mut start = 0;
    for row in 1..=series.angle_rad.len() {
        if series.angle_rad.get(row) != series.angle_rad.get(start) {
            if series.t_s[row - 1] - series.t_s[start] >= SHORTEST_S {
                parts.push(start..row);
            }
            start = row;
        }
    }
    parts
}

/// A channel that moves with the bar.
struct Mover<'a> {
    name: &'a str,
    t_s: Vec<f64>,
    components: Vec<&'a [f64]>,
}

impl<'a> Mover<'a> {
    fn of(name: &'a str, channel: &'a Channel, clock: Clock, origin: Stamp) -> Option<Mover<'a>> {
        let timeline = channel.series.timeline();
        let fits =
            matches!(channel.quantity, Quantity::AngularRate | Quantity::VelocityNed) && timeline.clock() == clock;
        fits.then(|| Mover {
            name,
            t_s: timeline.stamps().iter().map(|s| s.seconds_since(origin)).collect(),
            components: (0..3).map(|k| channel.series.component(k)).collect(),
        })
    }

    /// Whether it moves within `part` as it does outside of all `parts`.
    fn moves_in(&self, part: (f64, f64), parts: &[(f64, f64)]) -> bool {
        let is_within = |t: f64, (from, to): (f64, f64)| t > from + EDGE_S && t < to - EDGE_S;
        let inside = self.rms(|t| is_within(t, part));
        let outside = self.rms(|t| parts.iter().all(|(from, to)| t < *from || t > *to));
        inside.zip(outside).is_some_and(|(inside, outside)| inside > REST * outside)
    }

    /// Root mean square about the mean, all components together.
    fn rms(&self, chosen: impl Fn(f64) -> bool) -> Option<f64> {
        let rows: Vec<usize> = (0..self.t_s.len()).filter(|&row| chosen(self.t_s[row])).collect();
        let n = rows.len() as f64;
        let square = |component: &&[f64]| {
            let values = || rows.iter().map(|&row| component[row]);
            let mean = values().sum::<f64>() / n;
            values().map(|v| (v - mean).powi(2)).sum::<f64>() / n
        };
        (rows.len() >= LEAST_ROWS).then(|| self.components.iter().map(square).sum::<f64>().sqrt())
    }
}
