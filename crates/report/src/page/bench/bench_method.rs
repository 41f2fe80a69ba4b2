//! The method in words and equations, with the options that were used.

use super::super::{exact, plain};
use crate::number;
use crate::text::shown;
use flight::Clock;
use maud::{Markup, html};
use record::{BenchFindings, ChannelDynamics, ClockFinding, ReferenceFinding, TimeBasis, Verdict};

/// The method section, ready to paste into a report.
pub(super) fn section(findings: &BenchFindings) -> Markup {
    let channels = &findings.channels;
    html! {
        h2 id="method" { "Method" }
        (rig(&findings.reference))
        (smoother(&findings.reference))
        (kinematics())
        (delay(channels))
        (uncertainty(channels))
        (clocks(&findings.clocks))
        (verdicts(channels))
        (dynamics(channels))
        (injection(channels))
        p {
            "± is the expanded uncertainty U = k u with k = 2 throughout, u the standard uncertainty in the record; \
             intervals of 95 % take the quantile of Student. " (zero(findings)) "."
        }
    }
}

/// Definition of t = 0.
fn zero(findings: &BenchFindings) -> String {
    let utc = jiff::Timestamp::from_nanosecond(i128::from(findings.origin_ns)).ok();
    match utc.filter(|_| findings.clock == Clock::Unix) {
        Some(utc) => format!("t = 0: {} UTC", utc.strftime("%Y-%m-%d %H:%M:%S.%6f")),
        None => format!("t = 0: timestamp {} ns, clock {}", findings.origin_ns, findings.clock),
    }
}

fn rig(reference: &ReferenceFinding) -> Markup {
    html! {
        p {
            "A bar is swung by hand or swings free about a level axis. A rotary encoder of "
            (exact(reference.counts_per_rev)) " counts per revolution (" (shown(&reference.counts_source))
            ") reads its angle ξ, and the sensor at its end, at the lever arm r that the rig file gives for each \
             channel, is compared with what that motion should make it measure (Park and Lee 2010, section 2). ξ is \
             zero with body axes level, and grows as the body's z axis turns to x′, the level direction at azimuth η:"
        }
        p.equation { "ξ_k = s 2π n_k / N + ξ₀,  s = " (if reference.sign < 0.0 { "−1" } else { "+1" })
            ",  N = " (number::exact(reference.counts_per_rev)) }
    }
}

fn smoother(reference: &ReferenceFinding) -> Markup {
    html! {
        p {
            "Counts are not differenced. A Rauch–Tung–Striebel smoother with state (ξ, ξ′, ξ″, ξ‴), driven by white \
             snap of spectral density q and given the counts with the variance of their quantisation, gives the motion \
             and its covariance at irregular timestamps; q = 10^" (number::fixed(reference.log10_q, 2))
            " rad²/s⁷ has the least generalised cross-validation:"
        }
        p.equation { "GCV(q) = n RSS / (n − tr H)²,  R = (2π/N)² / 12" }
    }
}

fn kinematics() -> Markup {
    html! {
        p { "With C = Rz(η) Ry(ξ) from body to north-east-down, gravity g and field b, each channel at its own lever arm r \
         should see:" }
        p.equation { "p = C r,  v = dp/dt,  f = Cᵀ (d²p/dt² − g e_D),  ω = (0, ξ′, 0),  m = Cᵀ b" }
    }
}

fn delay(channels: &[ChannelDynamics]) -> Markup {
    let robust = channels.iter().filter_map(|c| c.checks.as_ref()).any(|c| c.downweighted_share > 0.0);
    let components = || channels.iter().flat_map(|c| &c.components);
    let drifts = components().any(|c| c.drift.is_some());
    let wanders = components().filter_map(|c| c.noise.as_ref()).any(|n| n.wander_std > 0.0);
    html! {
        p { "A positive delay is late: measured(t) = truth(t − τ). Each channel is fitted with one delay τ for all components \
         that the swing moves, and for each component a gain a, an offset b" @if drifts { ", a drift d" }
            " and noise n of its own; r is a cubic spline through the reference motion, t_m the middle of the record:" }
        p.equation { "y_k = a r(t_k − τ) + b" @if drifts { " + d (t_k − t_m)" } " + n_k" }
        p {
            (search(channels))
            "then τ by Gauss–Newton with the linear parameters projected out. "
            @if wanders {
                "Noise is an Ornstein–Uhlenbeck process and white noise together, whitened exactly at the \
                 actual timestamps by a scalar Kalman filter, and fitted by restricted maximum likelihood (REML); where its two \
                 parameters are not justified, white noise alone is used. "
            } @else {
                "Noise was found white in every channel: an Ornstein–Uhlenbeck part was tried by restricted maximum \
                 likelihood (REML), but its two parameters were not justified. "
            }
            @if robust {
                "Where whitened residuals have long tails, Huber weights (k = 1.345) downweight the farthest samples; \
                 their share is given. "
            }
            (held(channels))
        }
    }
}

/// The range of the search for an initial value.
fn search(channels: &[ChannelDynamics]) -> Markup {
    let curves = || channels.iter().filter_map(|c| c.checks.as_ref()).map(|c| &c.objective.delay_s);
    let first = curves().filter_map(|d| d.first()).copied().reduce(f64::min);
    let last = curves().filter_map(|d| d.last()).copied().reduce(f64::max);
    html! {
        @match (first, last) {
            (Some(first), Some(last)) => {
                "A first value is sought over " (number::significant(first, 3)) " to " (number::significant(last, 3)) " s, "
            }
            _ => { "A first value is sought over a grid, " }
        }
    }
}

fn held(channels: &[ChannelDynamics]) -> Markup {
    let held: Vec<&str> = channels.iter().filter(|c| c.held_rows > 0).map(|c| c.name.as_str()).collect();
    html! {
        @if !held.is_empty() {
            "Repeats of held values are removed before the fit ("
            @for (i, name) in held.iter().take(20).enumerate() { @if i > 0 { ", " } code { (shown(name)) } }
            "): the delay is that of the measurement. A loop that reads the held value gets it later by half the time \
             between updates, its mean age; both numbers are given."
        }
    }
}

fn uncertainty(channels: &[ChannelDynamics]) -> Markup {
    let count = |is: fn(&&ChannelDynamics) -> bool| channels.iter().filter(is).count();
    let with_delay = count(|c| c.delay.is_some());
    let by_hac = count(|c| c.delay.as_ref().is_some_and(|d| d.hac_s > d.hessian_s));
    html! {
        p {
            "The standard uncertainty of τ is the larger of the one from the Hessian of the whitened fit and the one that \
             allows for heteroscedasticity and correlation (Newey and West, Bartlett kernel, bandwidth after Andrews)"
            @if with_delay > 0 { "; here the second was the larger in " (by_hac) " of " (with_delay) " channels" }
            ". Coarse timestamps add u_stamps, and an anchor adds its own u_anchor. This is the uncertainty of one \
             record: differences from record to record show when records are combined on a card."
        }
        p.equation { "u²(τ) = max(u_Hessian, u_HAC)² + u_stamps² + u_anchor²,  τ ± t_0.975(ν) u(τ)" }
    }
}

fn clocks(clocks: &ClockFinding) -> Markup {
    html! {
        p {
            @match &clocks.basis {
                TimeBasis::OneClock => {
                    "Encoder and sensor were timestamped by one clock. An offset of these timestamps looks the same as \
                     a delay. "
                }
                TimeBasis::Pps => {
                    "The pulse per second relates the device's clock to the encoder's by a line from pulse to pulse. "
                }
                TimeBasis::FastestArrivals => {
                    "The fastest arrivals relate the device's clock to the encoder's. The least transport latency \
                     looks the same as a delay. "
                }
                TimeBasis::Anchor { channel } => {
                    "Encoder and sensor were timestamped by different clocks. The channel " code { (shown(channel)) }
                    " is assumed to be on time: its lag is the offset of the clocks, which is subtracted from all \
                     other delays. "
                }
            }
            "One skew ε is fitted for all channels of a clock, with the column a (t − t_m) r′; at the middle of the \
             record it is not correlated with τ. "
            @if clocks.hull.is_some() {
                "Device time was mapped to arrival by the lower convex hull of arrival − device time, that is by the \
                 fastest arrivals; what lies above it is latency. "
            }
        }
    }
}

fn verdicts(channels: &[ChannelDynamics]) -> Markup {
    let has = |verdict| channels.iter().any(|c| c.verdict == verdict);
    html! {
        p {
            "Verdicts: “on time” if the 90 % interval lies within the margin (equivalence test: two one-sided tests of \
             5 %). The margin is δ, half the interval between updates but at least 5 ms; where the 95 % interval excludes \
             zero, it is 5 ms. A number in the rig file replaces both. Otherwise “late” or “early” if the 95 % interval \
             excludes zero; else “not decided”, with the smallest delay that would be seen with a power of 80 %, 2.8 u"
            @if has(Verdict::Inconclusive) { ", and the length T (2.8 u/δ)² of a record that would decide" }
            ". The quality gate comes before any verdict. “No delay” is never reported without the number that proves \
             it."
        }
    }
}

fn dynamics(channels: &[ChannelDynamics]) -> Markup {
    let responses = || channels.iter().filter_map(|c| c.response.found());
    let windows = || channels.iter().filter_map(|c| c.stationarity.found());
    let is_known = |found: bool, text: &'static str| if found { text } else { "" };
    html! {
        p {
            (is_known(channels.iter().any(|c| c.model.found().is_some()),
                "Delay or lag: a delay (D), a first-order lag (L), both (DL), and a delay with two lags (DLL) are \
                 fitted with the same noise, lags by the exact recursion for a reference that is straight between \
                 samples; the least Bayesian information criterion is chosen, and “not distinguished” is reported if \
                 the next is within 6. The sum of delay and lags is known far better than the parts. "))
            @if let Some(found) = responses().next() {
                "Frequency responses are H₁ = S_xy/S_xx by Welch's method (Hann, half overlapping, segments of "
                (plain(found.segment_s, 3)) " s), after the fitted delay was taken out; its phase is put back afterwards. 95 % \
                 bands are 1.96 √((1 − γ²)/(2 n γ²)) with n effective averages; bins with γ² below 0.6 or with less than 1 % \
                 of the peak power of the reference are pale and not relied on. "
            }
            @if let Some(found) = windows().next() {
                "The delay over the record is fitted in windows of " (exact(found.window_s))
                " s; whether it is constant is tested on windows that do not overlap. "
            }
        }
    }
}

fn injection(channels: &[ChannelDynamics]) -> Markup {
    html! {
        @if channels.iter().any(|c| !c.injections.is_empty()) {
            p {
                "Injection and recovery: known delays and gains are added to the second half of the measured data, \
                 both halves are fitted again, and the measured difference is compared with what was added."
            }
        }
    }
}
