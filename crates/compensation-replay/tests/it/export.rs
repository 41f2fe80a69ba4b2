//! The exported C, compiled, run and compared with the replay.

use compensation_replay::{
    CExport, CFloat, CSource, CompensatorKind, CompensatorOptions, ExportError, PadeForm, PadeTustin, VelocityFilter,
    export_c,
};
use record::StartRule;
use std::path::Path;
use std::process::Command;

const TD: f64 = 0.4;
const STEP: f64 = 0.01;
/// Real poles, pairs and both together; every discretisation; first order to fourth.
const KINDS: [&str; 7] = [
    "pade-0-1-zoh",
    "pade-1-1-tustin",
    "pade-1-1-matched",
    "pade-1-2-tustin",
    "pade-2-2-foh",
    "pade-2-3-foh",
    "pade-4-4-foh",
];

fn export(kind: &str, real: CFloat) -> CExport {
    let kind: CompensatorKind = kind.parse().unwrap();
    CExport {
        kind,
        prefix: format!("{}_{}", kind.to_string().replace('-', "_"), real.c_name()),
        delay_s: TD,
        delay_uncertainty_s: Some(0.0021),
        delay_source: "bench 2026-03 */ swing \"7\" /* ± ok\nsecond line \\".to_owned(),
        step_s: STEP,
        max_age_s: 0.5,
        real,
    }
}

/// Turns, a step and standstill, m/s: sums of sines that both sides read as literals.
fn velocities() -> Vec<f64> {
    (0..600)
        .map(|k| {
            let t = f64::from(k) * STEP;
            let turn = 17.5 * (0.583 * t).cos() + 2.0 * (5.1 * t).sin();
            if k >= 400 { if k < 500 { 20.0 } else { 0.0 } } else { turn }
        })
        .collect()
}

/// The C compilers of this machine.
fn compilers() -> Vec<&'static str> {
    let is_here = |cc: &&str| Command::new(cc).arg("--version").output().is_ok_and(|out| out.status.success());
    let (here, missing): (Vec<_>, Vec<_>) = ["gcc", "clang"].into_iter().partition(|cc| is_here(cc));
    for cc in missing {
        println!("SKIPPED: no `{cc}` on this machine, the exported C was not compiled with it");
    }
    here
}

/// A program that prints the displacement after every step: warm, then cold.
fn program(prefix: &str, real: CFloat) -> String {
    let values: Vec<String> = velocities().iter().map(|v| format!("{v:.17e}")).collect();
    let (real, digits) = (real.c_name(), if real == CFloat::Float { 9 } else { 17 });
    format!(
        "#include <stdio.h>\n#include \"{prefix}.h\"\n
static const double velocity[] = {{ {} }};

int main(void)
{{
    {prefix}_t c;
    unsigned k, cold;
    for (cold = 0; cold < 2; ++cold) {{
        if (cold) {prefix}_init_cold(&c, ({real})velocity[0]);
        else {prefix}_init_warm(&c, ({real})velocity[0]);
        printf(\"%.{digits}g\\n\", (double){prefix}_position(&c, 0));
        for (k = 1; k < sizeof velocity / sizeof *velocity; ++k)
            printf(\"%.{digits}g\\n\", (double){prefix}_step(&c, ({real})velocity[k]));
    }}
    return 0;
}}
",
        values.join(", ")
    )
}

fn write(folder: &Path, source: &CSource) {
    std::fs::write(folder.join(&source.header_name), &source.header).unwrap();
    std::fs::write(folder.join(&source.source_name), &source.source).unwrap();
}

/// Compiles with warnings as errors, runs, and reads the printed values.
fn run(cc: &str, export: &CExport, program: &str) -> Vec<f64> {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &export_c(export).unwrap());
    std::fs::write(folder.path().join("main.c"), program).unwrap();
    let out = Command::new(cc)
        .current_dir(folder.path())
        .args([
            "-Wall",
            "-Wextra",
            "-Wconversion",
            "-Werror",
            "-std=c99",
            "-pedantic",
            "-O2",
            "-ffp-contract=off",
            "-o",
            "run",
            "main.c",
        ])
        .arg(format!("{}.c", export.prefix))
        .output()
        .unwrap();
    assert!(out.status.success(), "{}: {}", export.prefix, String::from_utf8_lossy(&out.stderr));
    let out = Command::new(folder.path().join("run")).output().unwrap();
    assert!(out.status.success());
    String::from_utf8(out.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect()
}

/// The replay's filter over the same velocities at the same step: warm, then cold.
fn replayed(kind: CompensatorKind) -> Vec<f64> {
    let v = velocities();
    let mut out = vec![];
    for start in [StartRule::Warm, StartRule::Cold] {
        if kind.to_string() == "pade-1-1-tustin" {
            let mut filter = match start {
                StartRule::Cold => PadeTustin::cold(TD, v[0], STEP),
                _ => PadeTustin::warm(TD, v[0]),
            };
            out.push(filter.output());
            out.extend(v[1..].iter().map(|v| filter.step(STEP, *v)));
        } else {
            let mut filter = kind.filter(TD).unwrap();
            filter.start(v[0], start, STEP);
            out.push(filter.displacement());
            out.extend(v[1..].iter().map(|v| filter.step(STEP, *v)));
        }
    }
    out
}

#[test]
fn double_in_c_gives_the_bits_of_the_replay() {
    for (cc, name) in compilers().into_iter().flat_map(|cc| KINDS.map(|name| (cc, name))) {
        let export = export(name, CFloat::Double);
        let (found, expected) = (run(cc, &export, &program(&export.prefix, export.real)), replayed(export.kind));
        assert_eq!(found.len(), expected.len(), "{name}");
        let differ = found.iter().zip(&expected).filter(|(a, b)| a.to_bits() != b.to_bits() && a != b).count();
        // -0 and +0 count as equal. Other machines than x86-64 may fuse: 2 ulp of the largest displacement.
        if cfg!(target_arch = "x86_64") {
            assert_eq!(differ, 0, "{name}: {differ} of {} differ", found.len());
        }
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() <= 2.0 * f64::EPSILON * 8.0, "{name}: {found} instead of {expected}");
        }
    }
}

/// Each mode forgets rounding over 1/(1 − |φ|) steps; states reach |ρ| |z| ≈ |ρ/λ| v.
fn float_rounding(kind: CompensatorKind) -> f64 {
    let CompensatorKind::Pade { m, n, .. } = kind else { panic!("{kind}") };
    let share = |mode: &compensation_replay::Mode| {
        let steps = 1.0 / (1.0 - (mode.pole.re * STEP / TD).exp());
        mode.weight() * (mode.residue / mode.pole).norm() * TD * 20.0 * steps
    };
    f64::from(f32::EPSILON) * PadeForm::new(m, n).unwrap().modes().iter().map(share).sum::<f64>()
}

#[test]
fn float_in_c_differs_by_rounding() {
    for (cc, name) in compilers().into_iter().flat_map(|cc| KINDS.map(|name| (cc, name))) {
        let export = export(name, CFloat::Float);
        let (found, expected) = (run(cc, &export, &program(&export.prefix, export.real)), replayed(export.kind));
        let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let bound = float_rounding(export.kind);
        println!("{name}: float differs by {worst:.1e} m at most (bound {bound:.1e} m)");
        assert!(worst < bound, "{name}: {worst} m, where rounding explains {bound} m");
        assert!(worst > 0.0, "{name}: a float cannot be that good");
    }
}

#[test]
fn the_files_name_their_source() {
    let source = export_c(&export("pade-2-2-foh", CFloat::Double)).unwrap();
    for text in [&source.header, &source.source] {
        for part in
            ["Pade [2/2], foh", "Td     0.400000 s, standard uncertainty 2.100 ms", "by flightlag", "0.01 s", "double"]
        {
            assert!(text.contains(part), "no {part:?} in\n{text}");
        }
        assert!(text.is_ascii());
        assert_eq!(text.matches("*/ swing").count(), 0, "the source of the delay cannot end the comment");
    }
    assert!(source.source.contains("#include \"pade_2_2_foh_double.h\""));
    assert!(!source.source.contains("math.h"));
    // The direct form from the note, in the comment.
    assert!(source.header.contains("b = ") && source.header.contains("-1.85374"), "{}", source.header);
    assert_eq!(source, export_c(&export("pade-2-2-foh", CFloat::Double)).unwrap());
    let unknown = CExport { delay_uncertainty_s: None, ..export("pade-1-1", CFloat::Float) };
    assert!(export_c(&unknown).unwrap().header.contains("uncertainty unknown"));
}

#[test]
fn unsupported_exports_are_rejected_with_the_reason() {
    for name in ["exact-fir", "kalman", "offline-shift", "rts-smoother"] {
        let refused = export_c(&export(name, CFloat::Double));
        assert!(matches!(refused, Err(ExportError::NotAFilter { .. })), "{name}");
    }
    let good = export("pade-1-1-foh", CFloat::Double);
    for step_s in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        assert!(matches!(export_c(&CExport { step_s, ..good.clone() }), Err(ExportError::Step(_))));
    }
    for prefix in ["", "1st", "a b", "a-b", "é", "double", "int8", "a_name_that_is_far_too_long_for_c99"] {
        let refused = export_c(&CExport { prefix: prefix.to_owned(), ..good.clone() });
        assert!(matches!(refused, Err(ExportError::Prefix(_))), "{prefix}");
    }
    for kind in [good.kind, "pade-1-1-tustin".parse().unwrap()] {
        let refused = export_c(&CExport { kind, delay_s: 0.0, ..good.clone() });
        assert!(matches!(refused, Err(ExportError::Compensator(_))), "{kind}");
    }
    let ring = CExport { kind: "exact-async".parse().unwrap(), ..good.clone() };
    for (max_age_s, step_s) in [(-0.1, STEP), (f64::NAN, STEP), (1e9, STEP), (1.0, 1e-6)] {
        let refused = export_c(&CExport { max_age_s, step_s, ..ring.clone() });
        assert!(matches!(refused, Err(ExportError::Age { .. })), "{max_age_s} {step_s}");
    }
    assert!(matches!(export_c(&CExport { delay_s: 0.0, ..ring }), Err(ExportError::Compensator(_))));
    let unstable = CompensatorKind::Pade { m: 0, n: 5, rule: compensation_replay::Discretisation::Foh };
    let refused = export_c(&CExport { kind: unstable, ..good }).unwrap_err();
    assert!(refused.to_string().contains("unstable"), "{refused}");
}

/// The exported filter equals the one that the replay builds by the same name.
#[test]
fn the_replay_filter_of_the_same_name_adds_the_same_displacement() {
    for name in KINDS {
        let kind: CompensatorKind = name.parse().unwrap();
        let mut compensator = kind.build(&CompensatorOptions::new(TD, STEP)).unwrap();
        let (v, expected) = (velocities(), replayed(kind));
        compensator.start(0.0, v[0], StartRule::Warm).unwrap();
        compensator.position(0.0, 0.0).unwrap();
        for (k, v) in v.iter().enumerate().skip(1) {
            compensator.velocity(k as f64 * STEP, *v).unwrap();
            let found = compensator.output(k as f64 * STEP).unwrap();
            // Timestamps in seconds round the step in its last bits.
            assert!((found - expected[k]).abs() < 1e-11, "{name} step {k}: {found} instead of {}", expected[k]);
        }
    }
}

/// Fixes at 4 Hz that are 30 ms old when they reach the velocity loop; positions and ages are literals on both sides.
fn fixes() -> Vec<(usize, f64, f64)> {
    (1..=23).map(|k| (25 * k, 100.0 + 3.0 * (k as f64).sin(), 0.03)).collect()
}

/// Prints the position after every step once there is one; rejected fixes are not printed.
fn ring_program(prefix: &str, real: CFloat) -> String {
    let list = |x: Vec<f64>| x.iter().map(|x| format!("{x:.17e}")).collect::<Vec<_>>().join(", ");
    let (velocity, fixes) = (list(velocities()), fixes());
    let at = fixes.iter().map(|f| f.0.to_string()).collect::<Vec<_>>().join(", ");
    let (late, age) = (list(fixes.iter().map(|f| f.1).collect()), list(fixes.iter().map(|f| f.2).collect()));
    let (real, digits) = (real.c_name(), if real == CFloat::Float { 9 } else { 17 });
    format!(
        "#include <stdio.h>\n#include \"{prefix}.h\"\n
static const double velocity[] = {{ {velocity} }};
static const unsigned at[] = {{ {at} }};
static const double late[] = {{ {late} }};
static const double age[] = {{ {age} }};

int main(void)
{{
    static {prefix}_t c;
    unsigned k, cold;
    for (cold = 0; cold < 2; ++cold) {{
        unsigned next = 0;
        if (cold) {prefix}_init_cold(&c, ({real})velocity[0]);
        else {prefix}_init_warm(&c, ({real})velocity[0]);
        for (k = 1; k < sizeof velocity / sizeof *velocity; ++k) {{
            {prefix}_step(&c, ({real})velocity[k]);
            if (next < sizeof at / sizeof *at && at[next] == k) {{
                if (!{prefix}_fix(&c, ({real})late[next], ({real})age[next])) return 1;
                if ({prefix}_fix(&c, 0, -1) || {prefix}_fix(&c, 0, 9)) return 2;
                ++next;
            }}
            if (c.has_fix) printf(\"%.{digits}g\\n\", (double){prefix}_position(&c));
        }}
    }}
    return 0;
}}
"
    )
}

fn ring_replayed() -> Vec<f64> {
    let (v, fixes) = (velocities(), fixes());
    let mut out = vec![];
    for start in [StartRule::Warm, StartRule::Cold] {
        let kind: CompensatorKind = "exact-async".parse().unwrap();
        let mut compensator = kind.build(&CompensatorOptions::new(TD, STEP)).unwrap();
        // The cold start ramps up over one step.
        let before = if start == StartRule::Cold { 0.0 } else { v[0] };
        compensator.start(-STEP, before, StartRule::Warm).unwrap();
        compensator.velocity(0.0, v[0]).unwrap();
        for (k, v) in v.iter().enumerate().skip(1) {
            let t = k as f64 * STEP;
            compensator.velocity(t, *v).unwrap();
            if let Some((_, late, age)) = fixes.iter().find(|f| f.0 == k) {
                compensator.position(t - age, *late).unwrap();
            }
            out.extend(compensator.output(t));
        }
    }
    out
}

/// Double: sums of up to 600 terms of 20 m. Float: each of the 43 additions for a fix and the 25 after it rounds values
/// up to 10 m, and the late position itself is rounded.
#[test]
fn the_ring_in_c_agrees_with_the_replay() {
    let expected = ring_replayed();
    let rounding = |epsilon: f32| f64::from(epsilon) * (68.0 * 10.0 + 103.0);
    let reals = [(CFloat::Double, 1e-11), (CFloat::Float, rounding(f32::EPSILON))];
    for (cc, (real, bound)) in compilers().into_iter().flat_map(|cc| reals.map(|real| (cc, real))) {
        let export = export("exact-async", real);
        let found = run(cc, &export, &ring_program(&export.prefix, real));
        assert_eq!(found.len(), expected.len());
        let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("exact-async in {}: differs by {worst:.1e} m at most", real.c_name());
        assert!(worst < bound, "{worst} m, where rounding explains {bound} m");
    }
}
