//! Hand-made flights: closed formulas, no generator.

use flight::{Channel, ChannelSource, Clock, Delay, Flight, Geodetic, Quantity, Series, Stamp, StampKind, Timeline};

/// A channel from rows of (seconds, values).
pub fn channel(quantity: Quantity, rows: &[(f64, [f64; 3])]) -> Channel {
    let stamps = rows.iter().map(|(t, _)| Stamp(1_700_000_000_000_000_000).plus_seconds(*t)).collect();
    let timeline = Timeline::new(StampKind::Measured, Clock::Unix, stamps).unwrap();
    let components = (0..3).map(|k| rows.iter().map(|(_, v)| v[k]).collect()).collect();
    Channel {
        quantity,
        series: Series::new(timeline, components).unwrap(),
        present: vec![true; 3],
        other_stamps: vec![],
        held: vec![false; rows.len()],
        source: ChannelSource { topic: "made by hand".into(), type_name: String::new(), fields: vec![] },
    }
}

/// Position late by `td` at `position_hz`, velocity at `velocity_hz`, both exact, on the circle R = 30 m at 17.5 m/s.
pub fn circle(td: f64, duration_s: f64, position_hz: f64, velocity_hz: f64) -> Flight {
    let (radius, omega) = (30.0, 17.5 / 30.0);
    let at = |t: f64| [radius * (omega * t).sin(), -radius * (omega * t).cos(), 0.0];
    let rows = |hz: f64, f: &dyn Fn(f64) -> [f64; 3]| -> Vec<(f64, [f64; 3])> {
        (0..=(duration_s * hz) as usize).map(|k| k as f64 / hz).map(|t| (t, f(t))).collect()
    };
    let velocity = |t: f64| [17.5 * (omega * t).cos(), 17.5 * (omega * t).sin(), 0.0];
    let mut flight = Flight::default();
    flight.channels.insert("position.gps".into(), channel(Quantity::PositionNed, &rows(position_hz, &|t| at(t - td))));
    flight.channels.insert("velocity.gps".into(), channel(Quantity::VelocityNed, &rows(velocity_hz, &velocity)));
    flight.channels.insert("position.truth".into(), channel(Quantity::PositionNed, &rows(100.0, &at)));
    flight
}

/// East along the 60th parallel at 200 m/s: the aircraft's own velocity is always due east.
pub fn along_a_parallel(td: f64, duration_s: f64) -> Flight {
    let origin = Geodetic::from_degrees(60.0, 10.0, 1000.0);
    let radius = {
        let s = origin.latitude.sin();
        (flight::WGS84_A / (1.0 - flight::WGS84_E2 * s * s).sqrt() + 1000.0) * origin.latitude.cos()
    };
    let at = |t: f64| [origin.latitude, origin.longitude + 200.0 * t / radius, 1000.0];
    let rows = |hz: f64, f: &dyn Fn(f64) -> [f64; 3]| -> Vec<(f64, [f64; 3])> {
        (0..=(duration_s * hz) as usize).map(|k| k as f64 / hz).map(|t| (t, f(t))).collect()
    };
    let mut flight = Flight::default();
    flight.channels.insert("position.gps".into(), channel(Quantity::PositionGeodetic, &rows(10.0, &|t| at(t - td))));
    flight.channels.insert("velocity.gps".into(), channel(Quantity::VelocityNed, &rows(10.0, &|_| [0.0, 200.0, 0.0])));
    flight.channels.insert("position.truth".into(), channel(Quantity::PositionGeodetic, &rows(10.0, &at)));
    flight
}

/// A delay in seconds.
pub fn late(seconds: f64) -> Delay {
    Delay::from_seconds(seconds).unwrap()
}
