//! The exact asynchronous form in C: a ring of the last velocities, with the age of the fix as an input.

use super::c_source::{CExport, CSource, ExportError, provenance};
use crate::compensator::CompensatorOptions;

/// Maximum number of velocities for a small C file.
const MOST_SAMPLES: f64 = 65_535.0;

/// `x_est = p + I(t) − I(t − age − Td)` with piecewise linear velocity, as in
/// [`StreamingAsync`](crate::StreamingAsync).
///
/// The integral is computed from the ring at each fix and continued by trapezoids, so rounding does not grow with the
/// length of the flight. It differs from the replay by rounding: below 1e-11 m in `double` and 1e-4 m in `float` for Td
/// = 0.4 s at 100 Hz and velocities to 20 m/s (test `the_ring_in_c_agrees_with_the_replay`).
pub(super) fn export(export: &CExport) -> Result<CSource, ExportError> {
    export.kind.build(&CompensatorOptions::new(export.delay_s, export.step_s))?;
    let samples = ((export.delay_s + export.max_age_s) / export.step_s).ceil() + 2.0;
    if !(export.max_age_s >= 0.0 && samples <= MOST_SAMPLES) {
        return Err(ExportError::Age { max_age_s: export.max_age_s, most: MOST_SAMPLES as u32 });
    }
    let made_from = provenance(export, "exact-async", &usage(export), &method());
    let prefix = &export.prefix;
    Ok(CSource {
        header_name: format!("{prefix}.h"),
        header: format!("{made_from}\n{}", header(export, samples as u32)),
        source_name: format!("{prefix}.c"),
        source: format!("{made_from}\n{}", source(export)),
    })
}

fn usage(export: &CExport) -> Vec<String> {
    vec![
        format!("step   {} s, fixed: call step once per {} s", export.step_s, export.step_s),
        format!("age    of a fix up to {} s: call fix after step, for each new position", export.max_age_s),
    ]
}

fn method() -> Vec<String> {
    vec![
        "position = late_position + integral of velocity from (now - age - Td) to now,".to_owned(),
        "velocity linear between its samples".to_owned(),
    ]
}

fn header(export: &CExport, samples: u32) -> String {
    let (prefix, real) = (&export.prefix, export.real.c_name());
    let upper = prefix.to_ascii_uppercase();
    format!(
        "#ifndef {upper}_H
#define {upper}_H

#ifdef __cplusplus
extern \"C\" {{
#endif

/* Number of stored velocities. */
#define {upper}_SAMPLES {samples}u

/* State of one axis. Copy it to restart without a bump. */
typedef struct {{
    {real} velocity[{upper}_SAMPLES]; /* m/s, a ring */
    unsigned newest;        /* its newest sample */
    int has_fix;            /* 0 until the first fix: there is no position yet */
    {real} late_position;   /* m, of the newest fix */
    {real} displacement;    /* m, flown since the time of that position */
}} {prefix}_t;

/* Starts as if velocity (m/s) had always been flown: the usual start, and the restart after a gap. */
void {prefix}_init_warm({prefix}_t *c, {real} velocity);

/* Starts from rest: nothing was flown before, and velocity ramps up from zero over one step. */
void {prefix}_init_cold({prefix}_t *c, {real} velocity);

/* The next velocity, m/s, {step} s after the last. It must be a finite number. */
void {prefix}_step({prefix}_t *c, {real} velocity);

/* A new position, m, and its age at the newest velocity, s. Returns 1. Returns 0 and changes nothing if the age is
   negative, above {age} s or not a number. */
int {prefix}_fix({prefix}_t *c, {real} late_position, {real} age);

/* Where the vehicle is at the newest velocity, m. */
{real} {prefix}_position(const {prefix}_t *c);

#ifdef __cplusplus
}}
#endif

#endif
",
        step = export.step_s,
        age = export.max_age_s,
    )
}

fn source(export: &CExport) -> String {
    let (prefix, real) = (&export.prefix, export.real.c_name());
    let literal = |x: f64| export.real.literal(x);
    format!(
        "#include \"{prefix}.h\"

static unsigned before(unsigned at)
{{
    return at == 0u ? {upper}_SAMPLES - 1u : at - 1u;
}}

static void fill({prefix}_t *c, {real} velocity)
{{
    unsigned k;
    for (k = 0u; k < {upper}_SAMPLES; ++k)
        c->velocity[k] = velocity;
    c->newest = 0u;
    c->has_fix = 0;
    c->late_position = 0;
    c->displacement = 0;
}}

void {prefix}_init_warm({prefix}_t *c, {real} velocity)
{{
    fill(c, velocity);
}}

void {prefix}_init_cold({prefix}_t *c, {real} velocity)
{{
    fill(c, 0);
    {prefix}_step(c, velocity);
}}

void {prefix}_step({prefix}_t *c, {real} velocity)
{{
    const {real} last = c->velocity[c->newest];
    c->displacement += {half_step} * (last + velocity);
    c->newest = c->newest + 1u == {upper}_SAMPLES ? 0u : c->newest + 1u;
    c->velocity[c->newest] = velocity;
}}

{fix}
{real} {prefix}_position(const {prefix}_t *c)
{{
    return c->late_position + c->displacement;
}}
",
        upper = prefix.to_ascii_uppercase(),
        half_step = literal(0.5 * export.step_s),
        fix = fix(export),
    )
}

/// The function that takes a late position: the distance flown since it was true, by trapezoids.
fn fix(export: &CExport) -> String {
    let (prefix, real) = (&export.prefix, export.real.c_name());
    let literal = |x: f64| export.real.literal(x);
    format!(
        "int {prefix}_fix({prefix}_t *c, {real} late_position, {real} age)
{{
    {real} steps, share, older, flown = 0;
    {real} newer = c->velocity[c->newest];
    unsigned at = c->newest, whole, k;
    if (!(age >= 0 && age <= {max_age}))
        return 0;
    steps = (age + {td}) / {step};
    whole = (unsigned)steps;
    share = steps - ({real})whole;
    for (k = 0u; k < whole; ++k) {{
        at = before(at);
        older = c->velocity[at];
        flown += {half_step} * (newer + older);
        newer = older;
    }}
    older = c->velocity[before(at)];
    flown += share * {step} * (newer + {half} * share * (older - newer));
    c->late_position = late_position;
    c->displacement = flown;
    c->has_fix = 1;
    return 1;
}}
",
        half_step = literal(0.5 * export.step_s),
        step = literal(export.step_s),
        td = literal(export.delay_s),
        max_age = literal(export.max_age_s),
        half = literal(0.5),
    )
}
