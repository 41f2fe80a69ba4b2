//! Table 5.7 of the design note: 2-D rms error of every compensator on six kinds of data, next to the note's figures.
//!
//! `cargo run --release -p flightlag-compensation-replay --example table_5_7`

#![allow(clippy::print_stdout)]

#[path = "../tests/it/like_flights.rs"]
mod like_flights;

use compensation_replay::{CompensatorKind, CompensatorOptions, KalmanSettings, VelocityView, fit_kalman};
use like_flights::LikeFlight;
use simulate::LikeCase;

/// Method of a row of the table.
#[derive(Clone, Copy)]
enum Row {
    Raw,
    HeldInputs(&'static str),
    Streaming(&'static str, VelocityView),
    /// Kalman settings estimated from the flight itself.
    Fitted(&'static str),
}

const NOTE_HIGH_ORDER: [Option<f64>; 6] = [None, Some(0.1413), Some(2.863), Some(0.941), Some(2.469), Some(2.503)];

/// Row, its method, and the note's A to F if given.
fn table() -> Vec<(Row, &'static str, [Option<f64>; 6])> {
    use VelocityView::{Bracketing, UpToNow};
    let note = |values: [f64; 6]| values.map(Some);
    let high = |first: f64| {
        let mut values = NOTE_HIGH_ORDER;
        values[0] = Some(first);
        values
    };
    vec![
        (Row::Raw, "raw, held", note([7.027, 7.028, 9.343, 7.830, 9.210, 9.219])),
        (
            Row::HeldInputs("pade-1-1-tustin"),
            "pade-1-1-tustin, held inputs",
            note([0.0371, 0.1462, 2.880, 0.958, 2.479, 2.513]),
        ),
        (Row::Streaming("pade-1-1-foh", UpToNow), "pade-1-1-foh", note([0.0371, 0.1462, 2.880, 0.959, 2.487, 2.521])),
        (Row::Streaming("pade-1-2-foh", UpToNow), "pade-1-2-foh", note([0.0057, 0.1414, 2.863, 0.941, 2.470, 2.503])),
        (Row::Streaming("pade-2-2-foh", UpToNow), "pade-2-2-foh", note([0.00145, 0.1414, 2.863, 0.941, 2.470, 2.503])),
        (Row::Streaming("pade-3-3-foh", UpToNow), "pade-3-3-foh", high(1.5e-4)),
        (Row::Streaming("pade-4-4-foh", UpToNow), "pade-4-4-foh", high(3e-5)),
        (Row::Streaming("pade-0-1-foh", UpToNow), "pade-0-1-foh", [None; 6]),
        (Row::Streaming("pade-0-2-foh", UpToNow), "pade-0-2-foh", [None; 6]),
        (Row::Streaming("pade-2-3-foh", UpToNow), "pade-2-3-foh", [None; 6]),
        (Row::Streaming("pade-3-4-foh", UpToNow), "pade-3-4-foh", [None; 6]),
        (Row::Streaming("pade-1-1-zoh", UpToNow), "pade-1-1-zoh", [None; 6]),
        (Row::Streaming("pade-1-1-matched", UpToNow), "pade-1-1-matched", [None; 6]),
        (
            Row::Streaming("exact-fir", Bracketing),
            "exact-fir, to next velocity",
            note([2e-5, 0.1414, 2.863, 0.941, 2.471, 2.506]),
        ),
        (
            Row::Streaming("exact-async", Bracketing),
            "exact-async, to next velocity",
            note([2e-5, 0.1414, 1.425, 0.0315, 0.0197, 0.429]),
        ),
        (Row::Streaming("exact-async", UpToNow), "exact-async, causal", [None; 6]),
        (Row::Streaming("offline-shift", UpToNow), "offline-shift", note([0.0, 0.1411, 1.331, 0.0263, 0.0004, 0.398])),
        (Row::Streaming("kalman", UpToNow), "kalman, q = 60", note([0.0, 0.0170, 0.127, 0.0196, 0.0131, 0.134])),
        (Row::Fitted("kalman"), "kalman, maximum likelihood", [None; 6]),
        (
            Row::Streaming("rts-smoother", UpToNow),
            "rts-smoother, q = 60",
            note([0.0, 0.0098, 0.094, 0.0094, 6e-5, 0.085]),
        ),
        (Row::Fitted("rts-smoother"), "rts-smoother, max. likelihood", [None; 6]),
    ]
}

fn error(row: Row, flight: &LikeFlight, options: &CompensatorOptions, fitted: &CompensatorOptions) -> f64 {
    let kind = |name: &str| -> CompensatorKind { name.parse().unwrap() };
    match row {
        Row::Raw => flight.rms_raw(),
        Row::HeldInputs(name) => flight.rms_on_held_inputs(kind(name), options),
        Row::Streaming(name, view) => flight.rms(kind(name), options, view),
        Row::Fitted(name) => flight.rms(kind(name), fitted, VelocityView::UpToNow),
    }
}

fn main() {
    let table = table();
    let mut squares = vec![[0.0; 6]; table.len()];
    let seeds = 0..4_u64;
    for (column, case) in LikeCase::ALL.into_iter().enumerate() {
        let (_, position_sigma, velocity_hz, velocity_sigma) = case.rates_and_noise();
        for seed in seeds.clone() {
            let flight = LikeFlight::of(case, seed);
            let kalman = KalmanSettings::circuit(position_sigma.max(1e-3), velocity_sigma.max(1e-3));
            let options =
                CompensatorOptions { kalman: Some(kalman), ..CompensatorOptions::new(0.4, 1.0 / velocity_hz) };
            let fit = fit_kalman(&[flight.samples(0), flight.samples(1)], 0.4, 0.0).unwrap();
            let fitted = CompensatorOptions { kalman: Some(fit), ..options };
            if seed == 0 {
                let KalmanSettings { jerk_density, position_sigma_m, velocity_sigma_mps, .. } = fit;
                println!(
                    "case {case:?}: maximum likelihood q {jerk_density:.1} m²/s⁵, position {position_sigma_m:.4} m, \
                     velocity {velocity_sigma_mps:.4} m/s"
                );
            }
            for (row, (how, _, _)) in table.iter().enumerate() {
                squares[row][column] += error(*how, &flight, &options, &fitted).powi(2) / 4.0;
            }
        }
    }
    println!(
        "\n2-D rms error, m: found (note)\n{:31}{}",
        "",
        "ABCDEF".chars().map(|c| format!("{c:>20}")).collect::<String>()
    );
    for ((_, title, note), squares) in table.iter().zip(&squares) {
        let cells = squares.iter().zip(note).map(|(square, note)| {
            let note = note.map_or(String::new(), |n| format!("({})", figure(n)));
            format!("{:>10}{note:>10}", figure(square.sqrt()))
        });
        println!("{title:31}{}", cells.collect::<String>());
    }
}

fn figure(x: f64) -> String {
    if x == 0.0 {
        "0".to_owned()
    } else if x < 1e-3 {
        format!("{x:.1e}")
    } else {
        format!("{x:.*}", (3 - x.log10().floor() as i32).clamp(0, 5) as usize)
    }
}
