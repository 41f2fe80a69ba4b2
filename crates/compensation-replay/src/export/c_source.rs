//! A compensator as a C header and a small C file.

use crate::compensator::{CompensatorError, CompensatorKind, Discretisation, StepGains};
use crate::export::c_float::CFloat;
use nalgebra::Complex;
use std::fmt::Write;

/// What to export, with the source of its delay.
#[derive(Debug, Clone, PartialEq)]
pub struct CExport {
    /// A Padé form or `exact-async`; all others need the whole record or matrices.
    pub kind: CompensatorKind,
    /// Prefix of all C identifiers and file names; letters, digits and underscores.
    pub prefix: String,
    /// Delay to remove, s; positive is late.
    pub delay_s: f64,
    /// Its standard uncertainty (k = 1), s, if known.
    pub delay_uncertainty_s: Option<f64>,
    /// Source of the delay, for the comment.
    pub delay_source: String,
    /// The fixed call interval of the controller, s.
    pub step_s: f64,
    /// Oldest fix that `exact-async` accepts, s; sets the length of the velocity ring. A Padé form ignores it.
    pub max_age_s: f64,
    /// Type of all numbers.
    pub real: CFloat,
}

/// Text of the two files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CSource {
    /// `<prefix>.h`.
    pub header_name: String,
    /// Text of the header.
    pub header: String,
    /// `<prefix>.c`.
    pub source_name: String,
    /// Text of the C file.
    pub source: String,
}

/// Why no C file can be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// Not a filter with a few numbers of state.
    #[error(
        "{name} cannot be written as C: choose a Padé form such as pade-1-1-tustin or pade-2-2-foh, or exact-async"
    )]
    NotAFilter {
        /// The compensator.
        name: String,
    },
    /// The compensator itself is rejected.
    #[error(transparent)]
    Compensator(#[from] CompensatorError),
    /// The step is invalid.
    #[error("a step of {0} s: it must be positive and finite")]
    Step(f64),
    /// The ring of velocities would be too long, or the age is invalid.
    #[error("fixes up to {max_age_s} s old: the age must be zero or more, and delay and age at most {most} steps")]
    Age {
        /// Requested age, s.
        max_age_s: f64,
        /// Maximum number of velocities.
        most: u32,
    },
    /// Not a C identifier.
    #[error(
        "{0:?} is not a C name: a letter, then letters, digits or underscores, at most 31, and no keyword or type of C"
    )]
    Prefix(String),
}

/// A Padé form.
pub(super) fn export(export: &CExport) -> Result<CSource, ExportError> {
    let body = match export.kind {
        CompensatorKind::Pade { m: 1, n: 1, rule: Discretisation::Tustin } => {
            export.kind.filter(export.delay_s)?;
            paper(export)
        }
        _ => modal(export)?,
    };
    let prefix = &export.prefix;
    Ok(CSource {
        header_name: format!("{prefix}.h"),
        header: header(export, &body),
        source_name: format!("{prefix}.c"),
        source: source(export, &body),
    })
}

/// The parts in which compensators differ.
struct Body {
    /// Number of states besides velocity and displacement.
    modes: usize,
    /// Meaning of the constants, for the comment.
    method: Vec<String>,
    warm: String,
    cold: String,
    step: String,
}

/// `y = ((Td − h) y + Td h (v + v₋)) / (Td + h)`, as [`PadeTustin`](crate::PadeTustin) computes it.
fn paper(export: &CExport) -> Body {
    let (td, h, real) = (export.delay_s, export.step_s, export.real);
    Body {
        modes: 0,
        method: vec!["y = ((Td - h) y + Td h (v + v_before)) / (Td + h)".to_owned()],
        warm: format!("    c->velocity = velocity;\n    c->displacement = {} * velocity;\n", real.literal(td)),
        cold: "    c->velocity = 0;\n    c->displacement = 0;\n".to_owned(),
        step: format!(
            "    c->displacement = ({} * c->displacement + {} * (velocity + c->velocity)) / {};\n    \
             c->velocity = velocity;\n",
            real.literal(td - h),
            real.literal(td * h),
            real.literal(td + h)
        ),
    }
}

/// Mode by mode, as [`ModalFilter`](crate::ModalFilter) computes it, in the same order.
fn modal(export: &CExport) -> Result<Body, ExportError> {
    let filter = export.kind.filter(export.delay_s)?;
    let poles = filter.form().modes().iter().map(|mode| mode.pole);
    let numbers = poles.zip(filter.gains_at(export.step_s)).zip(filter.warm_gains());
    let modes: Vec<Mode> = numbers
        .enumerate()
        .map(|(k, ((pole, (gains, share)), warm))| Mode { k, pole, gains, share, warm, real: export.real })
        .collect();
    let (b, a) = filter.direct_form(export.step_s);
    let list = |x: &[f64]| x.iter().map(|x| format!("{x:.17e}")).collect::<Vec<_>>().join(", ");
    let real = export.real.c_name();
    let unused_im = if modes.iter().any(Mode::is_paired) { ", im" } else { "" };
    let mut body = Body {
        modes: modes.len(),
        method: vec![
            "modes z = decay z + before v_before + now v, displacement = sum of Re(share z)".to_owned(),
            "the same filter in direct form, for comparison (a[0] = 1):".to_owned(),
            format!("b = {}", list(&b)),
            format!("a = {}", list(&a)),
        ],
        warm: "    c->velocity = velocity;\n    c->displacement = 0;\n".to_owned(),
        cold: "    c->velocity = 0;\n    c->displacement = 0;\n".to_owned(),
        step: format!(
            "    const {real} before = c->velocity;\n    {real} displacement = 0;\n    {real} re{unused_im};\n"
        ),
    };
    for mode in &modes {
        if mode.is_paired() { mode.write_pair(&mut body) } else { mode.write_real(&mut body) }
    }
    body.step.push_str("    c->velocity = velocity;\n    c->displacement = displacement;\n");
    Ok(body)
}

/// A real pole, or a pair of conjugate ones.
struct Mode {
    k: usize,
    /// Pole times Td.
    pole: Complex<f64>,
    gains: StepGains,
    share: Complex<f64>,
    /// Warm state per m/s.
    warm: Complex<f64>,
    real: CFloat,
}

impl Mode {
    fn is_paired(&self) -> bool {
        self.gains.decay.im != 0.0
    }

    fn write_pair(&self, body: &mut Body) {
        let Mode { k, pole, gains, share, warm, real } = self;
        let literal = |x: f64| real.literal(x);
        let (share_re, share_im) = (literal(share.re), literal(share.im));
        let _ = write!(
            body.warm,
            "    c->re[{k}] = {} * velocity;\n    c->im[{k}] = {} * velocity;\n    \
             c->displacement += {share_re} * c->re[{k}] - {share_im} * c->im[{k}];\n",
            literal(warm.re),
            literal(warm.im),
        );
        let _ = write!(body.cold, "    c->re[{k}] = 0;\n    c->im[{k}] = 0;\n");
        let _ = write!(
            body.step,
            "    /* poles {:.6} +- j {:.6} over Td */\n    \
             re = ({a} * c->re[{k}] - {b} * c->im[{k}]) + ({c} * before + {d} * velocity);\n    \
             im = ({a} * c->im[{k}] + {b} * c->re[{k}]) + ({e} * before + {f} * velocity);\n    \
             c->re[{k}] = re;\n    c->im[{k}] = im;\n    displacement += {share_re} * re - {share_im} * im;\n",
            pole.re,
            pole.im,
            a = literal(gains.decay.re),
            b = literal(gains.decay.im),
            c = literal(gains.before.re),
            d = literal(gains.now.re),
            e = literal(gains.before.im),
            f = literal(gains.now.im),
        );
    }

    fn write_real(&self, body: &mut Body) {
        let Mode { k, pole, gains, share, warm, real } = self;
        let literal = |x: f64| real.literal(x);
        let share = literal(share.re);
        let _ = write!(
            body.warm,
            "    c->re[{k}] = {} * velocity;\n    c->displacement += {share} * c->re[{k}];\n",
            literal(warm.re)
        );
        let _ = writeln!(body.cold, "    c->re[{k}] = 0;");
        let _ = write!(
            body.step,
            "    /* pole {:.6} over Td */\n    \
             re = {} * c->re[{k}] + ({} * before + {} * velocity);\n    \
             c->re[{k}] = re;\n    displacement += {share} * re;\n",
            pole.re,
            literal(gains.decay.re),
            literal(gains.before.re),
            literal(gains.now.re),
        );
    }
}

fn header(export: &CExport, body: &Body) -> String {
    let (prefix, real) = (&export.prefix, export.real.c_name());
    let guard = format!("{}_H", prefix.to_ascii_uppercase());
    let state = if body.modes == 0 {
        String::new()
    } else {
        format!(
            "    {real} re[{n}]; /* m, modes */\n    {real} im[{n}]; /* m, 0 and unused for real poles */\n",
            n = body.modes
        )
    };
    format!(
        "{provenance}
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern \"C\" {{
#endif

/* State of one axis. Copy it to restart without a bump. */
typedef struct {{
{state}    {real} velocity;     /* m/s, newest */
    {real} displacement; /* m, flown during the delay */
}} {prefix}_t;

/* Starts as if velocity (m/s) had always been flown: the usual start, and the restart after a gap. */
void {prefix}_init_warm({prefix}_t *c, {real} velocity);

/* Starts from rest: velocity ramps up from zero over the first step. */
void {prefix}_init_cold({prefix}_t *c, {real} velocity);

/* The next velocity, m/s, {step} s after the last. Returns the displacement, m. The velocity must be a finite number:
   NaN and infinity stay in the state until the next init. */
{real} {prefix}_step({prefix}_t *c, {real} velocity);

/* Where the vehicle is now, m, from the newest (late) position, m. */
{real} {prefix}_position(const {prefix}_t *c, {real} late_position);

#ifdef __cplusplus
}}
#endif

#endif
",
        provenance = of_filter(export, body),
        step = export.step_s,
    )
}

fn source(export: &CExport, body: &Body) -> String {
    let (prefix, real) = (&export.prefix, export.real.c_name());
    let Body { warm, cold, step, .. } = body;
    let unused = if body.modes == 0 { String::new() } else { zero_imaginary(body) };
    format!(
        "{provenance}
#include \"{prefix}.h\"

/* The bits of the replay need products and sums rounded one by one: -ffp-contract=off, which -std=c99 implies in gcc. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

void {prefix}_init_warm({prefix}_t *c, {real} velocity)
{{
{unused}{warm}}}

void {prefix}_init_cold({prefix}_t *c, {real} velocity)
{{
{unused}{cold}    (void){prefix}_step(c, velocity);
}}

{real} {prefix}_step({prefix}_t *c, {real} velocity)
{{
{step}    return c->displacement;
}}

{real} {prefix}_position(const {prefix}_t *c, {real} late_position)
{{
    return late_position + c->displacement;
}}
",
        provenance = of_filter(export, body),
    )
}

/// Real modes never use their imaginary part: it is set once.
fn zero_imaginary(body: &Body) -> String {
    (0..body.modes)
        .filter(|k| !body.step.contains(&format!("c->im[{k}]")))
        .map(|k| format!("    c->im[{k}] = 0;\n"))
        .collect()
}

fn of_filter(export: &CExport, body: &Body) -> String {
    let title = match export.kind {
        CompensatorKind::Pade { m, n, rule } => format!("Pade [{m}/{n}], {}", rule.name()),
        other => other.to_string(),
    };
    let usage = [
        format!("step   {} s, fixed: call step once per {} s", export.step_s, export.step_s),
        "fixes  Td is the age of a position on arrival. One that is held grows older until the next arrives:"
            .to_owned(),
        "       where that matters, use exact-async, which takes the age of each fix.".to_owned(),
    ];
    provenance(export, &title, &usage, &body.method)
}

/// The comment at the top of both files.
pub(super) fn provenance(export: &CExport, title: &str, usage: &[String], method: &[String]) -> String {
    let uncertainty = export
        .delay_uncertainty_s
        .map_or("uncertainty unknown".to_owned(), |u| format!("standard uncertainty {:.3} ms (k = 1)", u * 1e3));
    let mut lines = vec![
        format!("Delay compensator of one axis: {title}."),
        String::new(),
        format!("Td     {:.6} s, {uncertainty}", export.delay_s),
        format!("from   {}", comment_text(&export.delay_source)),
    ];
    lines.extend(usage.iter().cloned());
    lines.extend([
        format!("type   {}", export.real.c_name()),
        format!("made   by flightlag {}", env!("CARGO_PKG_VERSION")),
        String::new(),
        "Position arrives late by Td, velocity on time: x_est = x_late + displacement(velocity).".to_owned(),
        "Do not use it where the autopilot already removes the same delay (EKF2_GPS_DELAY, GPS1_DELAY_MS).".to_owned(),
        String::new(),
    ]);
    lines.extend(method.iter().cloned());
    let text: String = lines.iter().map(|line| format!(" * {line}").trim_end().to_owned() + "\n").collect();
    format!("/*\n{text} */\n")
}

/// On one line, in ASCII, and without the end of a comment.
fn comment_text(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c } else { '?' }).collect();
    plain.replace("*/", "* /").replace("/*", "/ *")
}
