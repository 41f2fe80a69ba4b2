//! The catalogue of notices and alarms: its page in the book, and a check that a test fires every code.

use flight::{Alarm, Code, Gravity, Severity};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const INTRODUCTION: &str = "\
# Notices

<!-- Made from crates/flight/src/notice/catalogue.rs: `just bless` writes it again. -->

A notice is something that happened to the data. It has a severity, a code, a place, a count and a sentence. The sentence on the page and in
the terminal has the details; this page explains the codes. `flightlag explain CODE` prints the same. Codes are stable names for scripts:
they are in `record.json`, in `inspect --json` and in `provenance.json`.

| severity | meaning | exit code |
|---|---|---|
| info | worth knowing; all numbers are unaffected | 0 |
| warning | something was assumed, skipped or repaired; check the numbers that depend on it | 0 |
| loss | data that the logger wrote could not be read | 3; `delay`, `campaign` and `bench` end with 0 if all losses are [minor](#minor-loss) |

Some codes of older releases were joined under one name. `flightlag explain` still knows the former names.
";

const ALARMS: &str = "
## Alarms of a delay

An alarm has a gravity instead of a severity. Red: do not use the number. Amber: the number is doubtful, and its interval is wider. Grey:
good to know. Some notices are also alarms; their text says so. The words for a delay that changes are explained under
[kinds of change](science/varying.md#words).
";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn entry(name: &str, grade: &str, happened: &str, advice: &str, former: &str) -> String {
    let former = if former.is_empty() { String::new() } else { format!("\n\nFormer names: {former}.") };
    format!("\n### {name}\n\n*{grade}*. {happened}\n\n**What to do:** {advice}{former}\n")
}

fn page() -> String {
    let mut page = INTRODUCTION.to_owned();
    let mut section = "";
    for code in Code::ALL {
        let e = code.entry();
        if e.section != section {
            section = e.section;
            page += &format!("\n## {section}\n");
        }
        let grade = e.severities.iter().map(|severity| severity.word()).collect::<Vec<_>>().join(", ");
        let former = code.former().map(|former| format!("`{former}`")).collect::<Vec<_>>().join(", ");
        page += &entry(e.name, &grade, e.happened, e.advice, &former);
    }
    page += ALARMS;
    for alarm in Alarm::ALL {
        let e = alarm.entry();
        page += &entry(e.name, e.gravity.word(), e.happened, e.advice, "");
    }
    page
}

/// `FLIGHTLAG_BLESS=1` rewrites it.
#[test]
fn the_page_of_notices_matches_the_catalogue() {
    let (path, made) = (root().join("docs/src/notices.md"), page());
    if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
        fs::write(&path, &made).unwrap();
    }
    assert!(fs::read_to_string(&path).unwrap() == made, "docs/src/notices.md: accept a change with `just bless`");
}

#[test]
fn each_name_belongs_to_one_code_and_is_short() {
    let mut names = BTreeSet::new();
    let former = Code::ALL.iter().flat_map(|code| code.former());
    let now = Code::ALL.iter().map(|code| code.name()).chain(Alarm::ALL.iter().map(|alarm| alarm.name()));
    for name in now.chain(former) {
        assert!(names.insert(name), "{name} appears twice");
        let plain = name.split('-').all(|word| !word.is_empty() && word.bytes().all(|b| b.is_ascii_alphanumeric()));
        assert!(plain && name.len() <= 30 && name == name.to_lowercase(), "{name}");
    }
}

#[test]
fn texts_are_sentences_of_at_most_28_words() {
    let of_notices = Code::ALL.iter().map(|code| (code.name(), code.entry().happened, code.entry().advice));
    let of_alarms = Alarm::ALL.iter().map(|alarm| (alarm.name(), alarm.entry().happened, alarm.entry().advice));
    for (name, happened, advice) in of_notices.chain(of_alarms) {
        for text in [happened, advice] {
            assert!(text.ends_with('.') || text.ends_with('?'), "{name}: {text}");
            assert!(text.starts_with(|c: char| c.is_uppercase()), "{name}: {text}");
            for sentence in text.split(". ") {
                let words = sentence.split_whitespace().count();
                assert!(words <= 28, "{name}: {words} words: {sentence}");
            }
        }
    }
}

#[test]
fn a_code_has_its_usual_severity_or_one_that_the_catalogue_allows() {
    for code in Code::ALL {
        let allowed = code.entry().severities;
        let distinct: BTreeSet<_> = allowed.iter().collect();
        assert_eq!(distinct.len(), allowed.len(), "{code}");
        for severity in [Severity::Info, Severity::Warning, Severity::Loss] {
            let made = std::panic::catch_unwind(|| code.at(severity));
            assert_eq!(made.is_ok(), allowed.contains(&severity), "{code} {severity:?}");
        }
    }
    assert!(Alarm::ALL.iter().any(|alarm| alarm.gravity() == Gravity::Red));
}

/// The body of a test, without its name.
fn body<'s>(source: &'s str, test: &str) -> Option<&'s str> {
    let at = source.find(&format!("fn {test}("))?;
    let (before, from) = source.split_at(at);
    let line = before.rfind('\n')? + 1;
    let is_test =
        before[..line].lines().rev().take_while(|l| l.trim_start().starts_with('#')).any(|l| l.trim() == "#[test]");
    let end = from.find(&format!("\n{}}}\n", &before[line..]))?;
    is_test.then(|| &from[test.len()..end])
}

/// Asserts that this test exists and names this code, as text or as a variant.
fn is_named(code: &str, variant: &str, file: &str, test: &str) {
    let source = fs::read_to_string(root().join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
    let body = body(&source, test).unwrap_or_else(|| panic!("{file} has no test {test}"));
    assert!(body.contains(&format!("\"{code}\"")) || body.contains(variant), "{file}: {test} does not name {code}");
}

/// One test for each code in which it fires. Remove a code that no input can fire.
#[test]
fn every_code_is_fired_by_a_test() {
    let codes: Vec<Code> = FIRED.iter().map(|(code, ..)| *code).collect();
    assert_eq!(codes, Code::ALL, "FIRED names a test for each code, in the order of the catalogue");
    FIRED.iter().for_each(|(code, file, test)| is_named(code.name(), &format!("Code::{code:?}"), file, test));
}

#[test]
fn every_alarm_is_fired_by_a_test() {
    let alarms: Vec<Alarm> = FIRED_ALARMS.iter().map(|(alarm, ..)| *alarm).collect();
    assert_eq!(alarms, Alarm::ALL, "FIRED_ALARMS names a test for each alarm, in the order of the catalogue");
    FIRED_ALARMS
        .iter()
        .for_each(|(alarm, file, test)| is_named(alarm.name(), &format!("Alarm::{alarm:?}"), file, test));
}

/// Code, file, test.
const FIRED: &[(Code, &str, &str)] = &[
    (Code::Damaged, "crates/logscan/src/ledger.rs", "damaged_ranges_are_losses_and_unlisted_ones_are_counted"),
    (Code::TailCut, "crates/logscan/src/ledger.rs", "a_last_record_cut_at_power_off_is_reported_but_not_a_loss"),
    (Code::MinorLoss, "crates/campaign/src/losses.rs", "a_loss_in_an_unused_topic_is_minor_and_named"),
    (
        Code::IncompleteRecording,
        "crates/ingest/tests/it/bag.rs",
        "a_bag_that_was_never_closed_is_read_whole_and_reported",
    ),
    (
        Code::Corrupt,
        "crates/ingest/tests/it/unpack.rs",
        "data_packed_before_the_damage_is_read_and_the_loss_is_located",
    ),
    (Code::Undecodable, "crates/ingest/tests/it/mcap.rs", "undecodable_messages_leave_no_row_and_are_a_counted_loss"),
    (Code::UnknownRecord, "crates/ingest/tests/it/ulog.rs", "unknown_types_and_flags_are_counted_and_the_rest_is_read"),
    (
        Code::MapLacks,
        "crates/ingest/tests/it/own_tables.rs",
        "a_field_that_the_log_lacks_is_an_error_with_the_nearest_name",
    ),
    (Code::SeveralSessions, "crates/ingest/tests/it/ulog.rs", "a_log_of_a_later_version_after_another_is_found"),
    (Code::Skipped, "crates/ingest/tests/it/dataflash.rs", "padding_at_the_end_is_not_damage_but_garbage_is"),
    (Code::ReadLeniently, "crates/ingest/tests/it/db3.rs", "trees_are_trusted_over_the_list_of_unused_pages"),
    (Code::NoChecksum, "crates/ingest/tests/it/nmea.rs", "a_log_without_any_checksum_is_read_and_reported"),
    (
        Code::IndexDiffers,
        "crates/formats/src/format/bag_folder.rs",
        "a_file_with_only_the_name_of_the_metadata_is_reported",
    ),
    (
        Code::Redefined,
        "crates/ingest/tests/it/dataflash.rs",
        "units_of_another_type_make_no_instances_and_are_reported",
    ),
    (Code::TooMuchData, "crates/formats/src/decode.rs", "a_small_log_cannot_claim_all_memory_and_the_rest_is_a_loss"),
    (Code::NotListed, "crates/formats/src/decode.rs", "a_log_of_many_bad_topics_gets_few_notices"),
    (
        Code::NotDecoded,
        "crates/ingest/tests/it/definitions.rs",
        "an_unknown_type_is_named_with_the_file_that_would_define_it",
    ),
    (
        Code::DefinitionSupplied,
        "crates/ingest/tests/it/db3.rs",
        "a_bag_without_definitions_uses_common_ones_if_they_fit",
    ),
    (Code::Dropout, "crates/ingest/tests/it/ulog.rs", "every_message_kind_is_read_and_fields_follow_their_format"),
    (
        Code::SeveralSources,
        "crates/ingest/tests/it/nmea.rs",
        "a_receiver_that_changes_its_talker_is_one_channel_throughout",
    ),
    (Code::NoRows, "crates/ingest/tests/it/csv.rs", "several_files_are_topics_of_one_log_and_a_stray_one_is_harmless"),
    (Code::ColumnRenamed, "crates/ingest/tests/it/csv.rs", "repeated_and_empty_names_become_unique_with_a_notice"),
    (Code::RejectedCell, "crates/ingest/tests/it/csv.rs", "a_column_wanted_as_a_number_reports_cells_that_are_not"),
    (Code::IrregularTable, "crates/ingest/tests/it/csv.rs", "a_repeated_header_between_the_rows_is_not_a_row"),
    (
        Code::UnknownWord,
        "crates/ingest/tests/it/bindings.rs",
        "contradictory_mt_manager_comments_leave_no_frame_assumed",
    ),
    (Code::Undated, "crates/ingest/tests/it/maps.rs", "xsens_utc_without_valid_flags_is_not_used"),
    (
        Code::RejectedRow,
        "crates/ingest/tests/it/bench.rs",
        "euler_angles_and_a_long_quaternion_of_one_attitude_give_one_quaternion",
    ),
    (
        Code::DuplicateStamp,
        "crates/ingest/tests/it/bind.rs",
        "rows_are_sorted_by_timestamp_and_the_first_of_equal_ones_is_kept",
    ),
    (
        Code::UnreliableStamps,
        "crates/ingest/tests/it/dataflash.rs",
        "a_clock_that_steps_back_is_reported_and_mere_disorder_is_not",
    ),
    (Code::StampKind, "crates/ingest/tests/it/bind.rs", "log_time_replaces_timestamps_never_filled_in_with_a_warning"),
    (
        Code::StampWrap,
        "crates/convert/tests/it/recover.rs",
        "a_recovered_log_keeps_its_order_across_a_clock_wraparound",
    ),
    (
        Code::DateInferred,
        "crates/ingest/tests/it/bindings.rs",
        "mt_manager_rows_without_utc_are_dated_by_the_devices_counter",
    ),
    (Code::ClockSuspect, "crates/ingest/tests/it/bind.rs", "timestamps_of_another_clock_yield_no_offset"),
    (Code::LeapSeconds, "crates/ingest/tests/it/time.rs", "a_flight_after_the_known_leap_seconds_is_reported"),
    (
        Code::UtcTie,
        "crates/ingest/tests/it/time.rs",
        "the_receivers_time_dates_the_clock_since_boot_and_moves_no_sample",
    ),
    (Code::BoundByGuess, "crates/ingest/tests/it/guess.rs", "a_path_too_straight_to_identify_yaw_is_reported"),
    (
        Code::Assumption,
        "crates/ingest/tests/it/bind.rs",
        "an_encoder_without_a_timestamp_uses_log_time_and_never_outranks_a_flight",
    ),
    (
        Code::HeldRows,
        "crates/ingest/tests/it/bench.rs",
        "a_held_vector_repeats_all_its_components_and_a_resting_encoder_is_measured",
    ),
    (
        Code::UnitUnknown,
        "crates/ingest/tests/it/own_tables.rs",
        "a_unit_of_another_quantity_is_rejected_and_an_unknown_one_is_reported",
    ),
    (Code::UnitDiffers, "crates/ingest/tests/it/dataflash.rs", "a_unit_that_differs_from_the_map_is_reported"),
    (
        Code::RecordSplit,
        "crates/compensation-replay/tests/it/flight_delay.rs",
        "a_clock_jump_of_an_hour_does_not_change_the_delay",
    ),
    (
        Code::SamplesLeftOut,
        "crates/compensation-replay/tests/it/flight_delay.rs",
        "more_samples_are_used_if_the_first_look_is_too_uncertain",
    ),
    (
        Code::AttitudeShift,
        "crates/compensation-replay/tests/it/flight_delay.rs",
        "attitude_and_accelerometer_are_shifted_to_the_same_time",
    ),
    (
        Code::FlightDelayChanges,
        "crates/campaign/src/delay/tests.rs",
        "a_measured_delay_that_changes_in_its_flight_gives_a_warning",
    ),
    (
        Code::DelayContradicted,
        "crates/campaign/src/delay/tests.rs",
        "a_delay_that_the_flight_contradicts_is_removed_with_a_warning",
    ),
    (
        Code::NoOutput,
        "crates/compensation-replay/tests/it/edges.rs",
        "noncausal_compensators_are_marked_and_stop_where_the_fixes_end",
    ),
    (
        Code::PositionReset,
        "crates/compensation-replay/tests/it/edges.rs",
        "one_reset_of_the_position_is_marked_and_passed_on",
    ),
    (Code::VelocityContradictsPosition, "crates/compensation-replay/tests/it/edges.rs", "swapped_axes_are_reported"),
    (
        Code::StampsCoarserThanDelay,
        "crates/compensation-replay/tests/it/edges.rs",
        "a_logger_that_writes_whole_seconds_cannot_show_a_shorter_delay",
    ),
    (
        Code::KalmanNoiseFitted,
        "crates/compensation-replay/tests/it/edges.rs",
        "noncausal_compensators_are_marked_and_stop_where_the_fixes_end",
    ),
    (
        Code::OnboardNotCompared,
        "crates/compensation-replay/tests/it/scores.rs",
        "an_onboard_channel_of_another_kind_is_rejected_with_the_reason",
    ),
    (Code::LeftOffCard, "crates/bench-analysis/src/card/combine/tests.rs", "an_outlying_record_is_excluded_and_named"),
    (
        Code::NotComparable,
        "crates/bench-analysis/src/card/combine/tests.rs",
        "an_absolute_and_a_relative_delay_are_not_averaged",
    ),
    (
        Code::CardConditions,
        "crates/campaign/src/delay/tests.rs",
        "timestamps_and_rates_that_differ_from_the_bench_are_reported",
    ),
    (Code::CardMismatch, "crates/campaign/src/card_tests.rs", "an_expired_card_is_used_and_its_flight_needs_attention"),
    (Code::CardRelative, "crates/campaign/src/delay/tests.rs", "a_delay_against_an_anchor_is_reported"),
    (
        Code::CardResidual,
        "crates/campaign/src/delay/tests.rs",
        "a_late_or_early_velocity_is_reported_and_leaves_the_delay_unchanged",
    ),
    (Code::ClockTie, "crates/bench-analysis/tests/it/clocks.rs", "a_channel_on_its_own_clock_is_skipped_and_named"),
    (
        Code::NoReference,
        "crates/bench-analysis/tests/it/references.rs",
        "without_an_azimuth_only_the_vertical_is_compared",
    ),
    (
        Code::RigContradicted,
        "crates/bench-analysis/tests/it/encoder.rs",
        "stated_counts_that_the_angle_contradicts_are_reported",
    ),
    (
        Code::EncoderRepaired,
        "crates/bench-analysis/tests/it/encoder.rs",
        "single_glitches_are_rejected_counted_and_reported",
    ),
    (Code::ValuesReplaced, "crates/convert/tests/it/original.rs", "a_log_recovered_twice_reads_as_the_original"),
    (Code::NotWritten, "crates/convert/src/recover.rs", "messages_found_but_not_written_are_a_loss"),
];

/// Alarm, file, test.
const FIRED_ALARMS: &[(Alarm, &str, &str)] = &[
    (Alarm::DelaySteps, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::DelaySwitches, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::DelayDrifts, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::DelayQueues, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::DelayBuildsUp, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::DelayWanders, "crates/campaign/src/answer/alarms.rs", "each_kind_of_change_has_its_own_red_alarm"),
    (Alarm::TwoDelaysFit, "crates/campaign/src/answer/alarms.rs", "doubts_about_a_fit_raise_an_alarm"),
    (
        Alarm::LeapSecond,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (Alarm::OtherTimeScale, "crates/campaign/src/answer/alarms.rs", "contradictory_pairs_raise_an_amber_alarm"),
    (Alarm::LogDamaged, "crates/campaign/src/losses.rs", "a_major_loss_is_a_red_alarm_with_its_place"),
    (Alarm::PairsDisagree, "crates/campaign/src/answer/alarms.rs", "contradictory_pairs_raise_an_amber_alarm"),
    (Alarm::ChannelLies, "crates/campaign/src/answer/alarms.rs", "contradictory_pairs_raise_an_amber_alarm"),
    (Alarm::DatumRefused, "crates/campaign/src/answer/alarms.rs", "contradictory_pairs_raise_an_amber_alarm"),
    (
        Alarm::DelayJitters,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (
        Alarm::LateFixes,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (
        Alarm::Bursts,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (Alarm::Outliers, "crates/campaign/src/answer/alarms.rs", "doubts_about_a_fit_raise_an_alarm"),
    (Alarm::DelayDoubtful, "crates/campaign/src/answer/alarms.rs", "doubts_about_a_fit_raise_an_alarm"),
    (
        Alarm::OtherReceiver,
        "crates/campaign/src/answer/tests.rs",
        "another_receiver_with_a_different_delay_is_reported",
    ),
    (
        Alarm::ParameterDiffers,
        "crates/campaign/src/answer/tests.rs",
        "a_parameter_that_states_a_delay_of_a_position_on_time_is_an_alarm",
    ),
    (Alarm::ReferenceNotUsed, "tests/it/reference.rs", "an_unusable_reference_file_is_an_alarm_with_its_reason"),
    (
        Alarm::ReferenceContradicted,
        "crates/campaign/src/answer/alarms.rs",
        "an_imu_that_is_not_on_time_against_the_reference_is_an_alarm",
    ),
    (Alarm::CardNotUsed, "crates/campaign/src/decide.rs", "a_card_that_does_not_apply_to_the_flight_is_an_alarm"),
    (
        Alarm::DelayDiffersBetweenParts,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (Alarm::DelayWindowsScatter, "crates/campaign/src/answer/alarms.rs", "doubts_about_a_fit_raise_an_alarm"),
    (
        Alarm::DelayRemark,
        "crates/campaign/src/answer/alarms.rs",
        "further_findings_of_the_test_over_time_are_reported_by_severity",
    ),
    (
        Alarm::Companion,
        "crates/campaign/src/answer/tests.rs",
        "a_companion_file_is_reported_as_such_without_a_delay_alarm",
    ),
];
