//! The catalogue: every code of a notice or an alarm, what it means, and what the user can do about it.
//!
//! An entry is: variant, code, severities with the usual one first, what happened, what to do. `docs/src/notices.md`
//! and `flightlag explain` are generated from these texts, and a test fires every code.

use super::code::catalogue;

/// Names of codes in records of older releases, and the code that replaces each.
pub(super) const FORMER: &[(Code, &str)] = &[
    (
        Code::IncompleteRecording,
        "incomplete-file empty-file no-end no-data-end no-begin no-messages missing-file write-ahead-log write-ahead-log-cut no-write-ahead-log unfinished-transaction",
    ),
    (
        Code::Corrupt,
        "packed-damage bad-utf16 data-checksum summary-checksum damaged-head missing-pages misplaced-pages bad-rows suspect-length",
    ),
    (Code::Undecodable, "bad-format no-time unknown-channel unknown-topic"),
    (Code::UnknownRecord, "private-record unknown-message newer-version unknown-flags"),
    (Code::SeveralSessions, "several-logs clock-restart restart-dated"),
    (Code::Skipped, "extra-bytes preamble padding prefix closed-chunks"),
    (
        Code::ReadLeniently,
        "no-dollar odd-padding longer-than-defined epoch-order found-pages copied-rows row-numbers unused-pages",
    ),
    (Code::NoChecksum, "unchecked no-chunk-checksum"),
    (
        Code::IndexDiffers,
        "miscounted-messages bad-index shifted metadata missing-messages original-unreadable original-cut",
    ),
    (Code::Redefined, "redefined-format several-definitions type-change units-differ late-instance"),
    (Code::TooMuchData, "too-many-values too-many-columns long-attachment"),
    (Code::NotListed, "more-texts more-topics"),
    (Code::DefinitionSupplied, "common-definition given-definition completed-definition"),
    (Code::SeveralSources, "several-talkers talker-changed several-devices several-publishers"),
    (Code::NoRows, "not-a-table"),
    (Code::ColumnRenamed, "no-header"),
    (Code::RejectedCell, "bad-number not-finite no-line-end"),
    (
        Code::IrregularTable,
        "header-changed header-repeated columns-not-read other-table doubtful-rows like-header marked-rows rows-like-remarks",
    ),
    (Code::UnknownWord, "status-unknown unknown-remark"),
    (Code::Undated, "untimed untimed-pulse headless no-epoch no-stamp utc-not-valid restart-undated"),
    (Code::RejectedRow, "unbound-velocity stamp-not-rising no-usable-row not-a-series"),
    (Code::DuplicateStamp, "coarse-stamps"),
    (
        Code::UnreliableStamps,
        "back-jump clock-jump stamp-out-of-range before-1970 receive-clock receive-time receive-clock-unset receive-clock-back",
    ),
    (Code::StampKind, "placed-stamps no-receive-time"),
    (Code::StampWrap, "turn-unclear"),
    (
        Code::DateInferred,
        "date-order no-zone stale-date counter-dated unix-stamps gps-week week-rollover week-glitch week-suspect",
    ),
    (Code::ClockSuspect, "clock-differs no-common-time"),
    (Code::UtcTie, "utc-outlier"),
    (
        Code::Assumption,
        "substitute absent-component zero-field height-datum magnetic-track rig-assumed encoder-sign-assumed encoder-zero-assumed gravity-assumed field-model-expired field-model-without-site",
    ),
    (Code::UnitDiffers, "unit-converted"),
    (Code::RecordSplit, "gap-split reset-split bench-turned"),
    (
        Code::SamplesLeftOut,
        "glitch-masked disturbed-stretch velocity-spike fix-far-away rest-left-out short-pieces delay-samples-thinned",
    ),
    (
        Code::NoOutput,
        "velocity-before-first-fix velocity-after-last-fix compensator-refused-samples compensator-without-output",
    ),
    (Code::LeftOffCard, "record-left-out channel-missing outlier no-card"),
    (Code::CardConditions, "card-rate rates-differ card-day-unknown card-without-day"),
    (Code::CardMismatch, "card-not-valid card-expired card-not-yet-valid card-stamp-kind"),
    (Code::CardResidual, "card-lag card-velocity"),
    (Code::ClockTie, "clock-not-tied no-hull no-such-stamp pulse-unusable alignment-ambiguous clock-drift"),
    (Code::NoReference, "channel-incomplete channel-without-reference azimuth-unknown"),
    (
        Code::RigContradicted,
        "rig-differs counts-per-rev-differ encoder-sign-differs mount-differs mount-side-differs card-rig-contradicted",
    ),
    (Code::EncoderRepaired, "encoder-spikes encoder-unwrapped"),
    (Code::ValuesReplaced, "cells-replaced zero-bytes absent-values log-time log-time-lent"),
    (Code::NotWritten, "fields-left-out"),
];

catalogue! {
    notices {
        "Bytes and damage" {
            Damaged, "damaged", [Loss],
                "A range of bytes is corrupt. The place gives the range, the text gives the reason. The last entry \
                 counts the ranges that are not listed.",
                "Copy the log again from the logger and compare the sizes. If it is still damaged, look for holes in \
                 the channels that you use. `recover` writes everything that can be read as MCAP.";
            TailCut, "tail-cut", [Info],
                "The file ends inside its last record, as after power-off. This is not a loss.",
                "Nothing, unless the log should be longer: then copy it again.";
            MinorLoss, "minor-loss", [Warning],
                "All losses of the log are minor and are listed as warnings. They are less than 0.1 % of the log. \
                 They leave no hole of more than 0.5 s in a channel that is used, or no channel uses the topic.",
                "Nothing. The losses are listed on the page of the flight.";
            IncompleteRecording, "incomplete-recording", [Loss, Warning, Info],
                "A part of the recording is missing, or the recorder was stopped before it closed the recording. A \
                 file is missing, is empty, or lacks its beginning, its end, its index or its table of messages. Or \
                 the newest pages of a database are in a write-ahead log or a journal. It is a warning if it is \
                 uncertain whether something is missing. It is info if the write-ahead log was read.",
                "Copy the log again, with all files of the recording and the `-wal` file of a database. If the \
                 recorder was stopped, everything that it had written was read.";
            Corrupt, "corrupt", [Loss],
                "Content fails a check that does not locate the damaged bytes: a checksum, a compressed or converted \
                 file, or the pages of a database. The text gives what was still read.",
                "Copy or unpack the log again and compare checksums. For a database, keep its `-wal` file with it.";
            Undecodable, "undecodable", [Loss],
                "Messages cannot be decoded. They do not fit their definition, have no usable format, or lack a \
                 field that their type must have. Or their compression is corrupt, or their topic is unknown.",
                "If the topic matters, compare the definition in the log with the software that wrote it. If the topic is unknown, look \
                 for damage before the messages: the record that announces it was probably lost.";
            UnknownRecord, "unknown-record", [Warning, Loss, Info],
                "Records of an unknown type, message number or format version were skipped. It is a loss where nothing \
                 else confirms the bytes, or where the log states that what was read may be wrong.",
                "Nothing, if you do not need them. If the log is newer than this release, update flightlag.";
            MapLacks, "map-lacks", [Warning],
                "Your own channel map names a field that the log lacks, so no channel is bound. For one log the exit code is 2 \
                 with `delay` and `inspect`, and 1 with `export`. `delay` raises it as a red alarm.",
                "Correct the map. `flightlag inspect` lists topics and fields, `flightlag maps --suggest` prints a map that fits.";
        }
        "Reading" {
            SeveralSessions, "several-sessions", [Warning],
                "The log holds several sessions: several logs one after another, or a boot clock that restarts. \
                 After a restart each session is dated by itself, or follows the one before after a time that the \
                 text states.",
                "Check that the sessions belong to one flight. If not, split the log.";
            Skipped, "skipped", [Info],
                "Text, lines or padding without records were skipped. Or chunks without a wanted topic were not \
                 decompressed; their messages are counted from the verified index.",
                "Nothing.";
            ReadLeniently, "read-leniently", [Warning, Info],
                "The log deviates from its format, but can only be read in one reasonable way: padding, order, \
                 length or page lists differ from the rule. The text states what was done.",
                "Nothing, if the values look right. Report it to the maker of the logger.";
            NoChecksum, "no-checksum", [Warning, Info],
                "Sentences or chunks have no checksum, so their content cannot be verified.",
                "Enable checksums in the recorder.";
            IndexDiffers, "index-differs", [Warning, Loss],
                "An index, a summary or metadata cannot be read, or disagrees with the content. The content is used. \
                 It is a loss where messages are missing or may be missing.",
                "After a loss, look at the other losses of this log: they give the place. Copy the log again, or \
                 recover the original again. Otherwise nothing.";
            Redefined, "redefined", [Warning, Info, Loss],
                "A topic, type, unit or number is defined twice, differently. Each message is read with the \
                 definition before it. Values that fit neither definition are not used.",
                "Check the topic that the text names. One recording should have one definition of each type.";
            TooMuchData, "too-much-data", [Loss, Warning],
                "Rows, columns, topics or attachments were not read: they exceed the limit of memory, columns or \
                 topics for a log.",
                "Split the log, or leave out topics that you do not need when you record.";
            NotListed, "not-listed", [Info, Warning, Loss],
                "There are more names, texts, changes or notices than are listed. The rest are only counted.",
                "Nothing. They are in the log.";
            NotDecoded, "not-decoded", [Warning],
                "A wanted topic cannot be decoded. The text gives the reason.",
                "Put the missing message definitions into the `--maps` folder.";
            DefinitionSupplied, "definition-supplied", [Info],
                "The log does not define a type completely. A built-in definition, or one from the `--maps` folder, \
                 was used instead or completed it.",
                "Nothing, if your software uses that definition. Otherwise put your own into the `--maps` folder.";
            Dropout, "dropout", [Warning],
                "The logger could not keep up. The text gives the total and the longest dropout.",
                "Use a faster storage card, or log fewer topics.";
            SeveralSources, "several-sources", [Info, Warning],
                "Several devices, talkers or publishers share one topic. The text states which one is used, or how \
                 they were joined.",
                "If more than one receiver was on board, name the wanted one in your channel map.";
        }
        "Text tables" {
            NoRows, "no-rows", [Info, Warning],
                "A file is not a table, or a table or topic has no rows.",
                "Check that this is the file you meant.";
            ColumnRenamed, "column-renamed", [Info, Warning],
                "Columns without a unique name were given one. Without a header row, columns are called `column_1`, \
                 `column_2` and so on.",
                "Add a header row, or use the new names in your channel map.";
            RejectedCell, "rejected-cell", [Warning, Loss, Info],
                "Cells in a column of numbers are not numbers, or the last value of a table may be truncated, \
                 because its row has no line end. They are not used. Words for a missing value, such as N/A or nan, \
                 are info. Many other cells are a loss.",
                "Look at the lines that the text gives. Correct the export, or the decimal sign.";
            IrregularTable, "irregular-table", [Info, Warning, Loss],
                "A text table has lines that are not, or may not be, rows of it. Examples are another header, rows \
                 of another table, and comments that look like rows. The text states what was read. Columns or rows \
                 that were not read are a loss. A line that may be the header of another table, or a comment, is a \
                 warning.",
                "Look at the lines that the text gives. Split the file where another table begins.";
            UnknownWord, "unknown-word", [Warning],
                "The log states a status or a remark that neither flightlag nor the channel map knows. Everything \
                 that depends on it is unknown or not bound.",
                "Look the word up in the manual of the device and add it to your channel map.";
        }
        "Time and clocks" {
            Undated, "undated", [Info, Warning, Loss],
                "The time of some messages is unknown: before the first known date or week, after damage, or after a \
                 restart of the boot clock. Or the receiver does not state it. These messages are dated from their \
                 neighbours, or not used. It is a loss if rows of a whole session are not used.",
                "Nothing, unless most rows are affected. Then log a message with date and time, in each session if the clock restarts.";
            RejectedRow, "rejected-row", [Warning, Info, Loss],
                "Rows are not used for a channel, or the channel has no rows left. The text gives the reason: no \
                 value, out of range, no fix, not finite, no position near them, timestamps that do not rise, and \
                 others.",
                "Look at the reason and at the first row. Rows without a value are normal where a device logs at \
                 several rates. If no row is left: did the receiver have no fix, or is the map wrong?";
            DuplicateStamp, "duplicate-stamp", [Warning, Loss],
                "Rows have the timestamp of another row and are not used. If their values differ, the timestamps are \
                 too coarse, and a delay may be wrong by the step of the timestamps. It is a loss if a wrong clock \
                 caused many of them.",
                "Log the time of measurement with each row, with more digits if the timestamps are coarse.";
            UnreliableStamps, "unreliable-stamps", [Warning, Loss],
                "Timestamps go back or jump, or are in years that are impossible or cannot be written. A clock was \
                 not set or was set during the log, or messages are out of order. Rows are sorted by timestamp, and \
                 a timestamp that cannot be written is set to the limit. It is a loss where the time of frames had \
                 to be taken from their neighbours.",
                "Check whether a clock was set during the flight. Set the clock of the logger or ground station \
                 before the flight.";
            StampKind, "stamp-kind", [Info, Warning],
                "A kind of timestamp is missing in some rows, is known to be unreliable, or was computed from the receive times of other \
                 messages.",
                "Check which kind of timestamp the channel uses: a delay is valid for that kind only.";
            StampWrap, "stamp-wrap", [Warning, Info],
                "A counter wrapped around, and the timestamps continue. If the number of wraps is unclear, they were left unchanged.",
                "Check that no device restarted at that time: a restart would look the same.";
            DateInferred, "date-inferred", [Info, Warning],
                "Dates, zones or GPS weeks are incomplete, ambiguous or impossible, and were inferred. Examples are \
                 the order of day and month, a missing zone read as UTC, the date after midnight, and dates from a \
                 counter. For a 10-bit GPS week, the nearest possible week is used.",
                "Compare the date and hour of the first row with the flight. State the format in your channel map. \
                 Update the firmware of an old receiver.";
            ClockSuspect, "clock-suspect", [Warning],
                "Two clocks differ by an amount that looks like an error, or position and velocity have no time in \
                 common. Examples are leap seconds, GPS time used as UTC, TAI, the hours of a time zone, and more \
                 than a day.",
                "Check the time scale of both clocks and the channel map: both channels must be from the same \
                 flight. A delay between them may be wrong by that amount.";
            LeapSeconds, "leap-seconds", [Warning],
                "The flight is after the last day for which this release knows the leap seconds.",
                "Update flightlag. The result changes only if there was a new leap second.";
            UtcTie, "utc-tie", [Info, Warning],
                "The clock of the log is dated by the named messages. It is a warning if messages that differ from \
                 them by more than a second were not used.",
                "Nothing. If many messages are not used, check the time of the receiver.";
        }
        "Channels and binding" {
            BoundByGuess, "bound-by-guess", [Warning],
                "No channel map fits. Columns were bound by name, unit and motion. This is also an amber alarm.",
                "Check the binding with `flightlag inspect`. `flightlag maps --suggest` prints the map to correct and keep.";
            Assumption, "assumption", [Warning, Info],
                "The channel map or the rig file assumes something that the log does not state or show. The text \
                 states the assumption. It is info if a part of a channel is not logged and has a substitute. \
                 Examples are zero, another field, the height above mean sea level, or a magnetic track.",
                "Check that the assumption holds. If not, use your own channel map, or state it in the rig file: site, gravity, magnetic \
                 field, zero or sign of the encoder.";
            HeldRows, "held-rows", [Info],
                "The channel repeats held values. The repeats are not measurements and are not used.",
                "Nothing.";
            UnitUnknown, "unit-unknown", [Warning],
                "The table states a unit that flightlag does not know. The unit in the channel map is used. This is \
                 also an amber alarm.",
                "Write the unit as flightlag knows it (`m`, `m/s`, `deg`, `rad` and so on).";
            UnitDiffers, "unit-differs", [Warning, Info],
                "The log states another unit than the channel map. For a table, the unit in the table is used; \
                 otherwise the unit in the map is used.",
                "Check one value by hand. Correct the map or the log.";
        }
        "Delay from flight" {
            RecordSplit, "record-split", [Warning],
                "The record is split at gaps, clock jumps or resets, or where the bench was turned. Each part has \
                 its own offset, or is a magnetometer swing at its own azimuth.",
                "Nothing, if they are expected. Many splits make the interval of the delay wider.";
            SamplesLeftOut, "samples-left-out", [Warning, Info],
                "Samples are not used for the delay: jumps, spikes, fixes far away, stretches where the channels \
                 contradict each other, rest, parts that are too short. If there are very many samples, only every \
                 n-th is used, or neighbours are averaged.",
                "Look at the marked samples on the page of the flight.";
            AttitudeShift, "attitude-shift", [Warning, Info],
                "The attitude is later or earlier than the gyro of the IMU. If it is later, it was shifted before it \
                 rotates the accelerometer to north and east. If it is earlier, the IMU is late, as behind a filter, and \
                 the accelerometer was shifted. It is info below 20 ms. Without a gyro the attitude cannot be tested, and a late \
                 one makes each lateness against the IMU too short.",
                "Nothing for the delay of the position. If you use the attitude or the IMU itself, correct its timestamps by \
                 the stated amount. If an attitude is early by more than 20 ms, check its timestamps. Log the gyro with the accelerometer.";
            FlightDelayChanges, "flight-delay-changes", [Warning],
                "The delay measured in this flight, or in a record of the bench, changes. `bench` ends with exit code 3.",
                "Look at the curve of the delay over time before you remove a constant delay.";
            DelayContradicted, "delay-contradicted", [Warning],
                "The removed delay contradicts the flight. This is also an amber alarm.",
                "Compare both delays on the page. Check whether the configuration was changed after the delay was \
                 measured.";
        }
        "Replay and scores" {
            NoOutput, "no-output", [Info, Warning],
                "Rows without output: velocity before the first or after the last fix, samples that a compensator \
                 rejected, or rows at which a compensator has no output.",
                "Nothing, unless many rows are affected: then look at the named compensator.";
            PositionReset, "position-reset", [Warning],
                "Fixes jump by more than five sigma against the integrated velocity. They were used unchanged.",
                "Look for resets of the filter or changes of the fix type at that time.";
            VelocityContradictsPosition, "velocity-contradicts-position", [Warning],
                "Position and integrated velocity disagree.",
                "Check axes, signs, units and the delay.";
            StampsCoarserThanDelay, "stamps-coarser-than-delay", [Warning],
                "The timestamps are no finer than the delay. They cannot show whether the compensation is correct.",
                "Log timestamps with more digits.";
            KalmanNoiseFitted, "kalman-noise-fitted", [Info],
                "The noise was fitted for the Kalman filter and the smoother.",
                "Nothing. State the noise in the pipeline to use your own.";
            OnboardNotCompared, "onboard-not-compared", [Warning],
                "The aircraft's own compensated position cannot be compared. The text gives the reason.",
                "Log the onboard output with the timestamps of the position, or remove it from the pipeline.";
        }
        "Sensor card" {
            LeftOffCard, "left-off-card", [Warning],
                "A record, or a channel of a record, is not on the card: it could not be measured, is missing, or is \
                 an outlier. If nothing is left, no card is written.",
                "Look at the page of that record. Measure again if too few are left.";
            NotComparable, "not-comparable", [Warning],
                "A channel of a record cannot be combined with the others: another kind of timestamp, model or quantity, or delays that \
                 disagree without a clear majority. Then `bench` ends with exit code 3.",
                "Make one card for each configuration.";
            CardConditions, "card-conditions", [Warning],
                "Update rates differ between the records of the bench, or between bench and flight. Or the day of \
                 the bench records or of the flight is unknown, so the validity of the card is unknown. Or a record \
                 failed a check of its quality gate, such as a gap of the encoder or a swing that is too small.",
                "Set the same rate on the bench and in flight. Log a date, or check the validity by hand. Look at the quality gate on \
                 the page of the record.";
            CardMismatch, "card-mismatch", [Warning],
                "The flight is before the first or after the last day of the card, or uses another kind of timestamp \
                 than the bench. The card is used anyway.",
                "Use a card that is valid on the day of the flight, or measure the sensor again. Use the same kind \
                 of timestamp in both channel maps.";
            CardRelative, "card-relative", [Warning],
                "The delay on the card is relative to a channel that the bench assumed to be on time, or includes \
                 the least transport latency.",
                "Tie the clocks on the bench, for example with a pulse per second.";
            CardResidual, "card-residual", [Warning, Info],
                "An error remains after the delay on the card is removed. Of a lag, the lateness of slow motion is removed, and \
                 fast motion has another. Or the velocity itself is late.",
                "Nothing, if the error is small enough: the text gives its size or its cause.";
        }
        "Bench" {
            ClockTie, "clock-tie", [Warning],
                "The tie between the clocks of a channel and of the encoder is missing, ambiguous, or drifts. The \
                 text states what is missing: a usable pulse, pairs of device time and arrival, or the timestamps \
                 that the rig file asks for. The channel may be skipped. The tie is ambiguous if the swing is too \
                 regular. If all channels drift, the delays are valid for the middle of the record. A gyro that is \
                 far too late or too early shows that the clocks are probably not one clock.",
                "Check the pulse, the timestamps and the clock settings of the rig file. Stop the bar once or twice \
                 during the record. To avoid a drift, timestamp encoder and sensor with one clock.";
            NoReference, "no-reference", [Warning],
                "A channel cannot be compared with the motion of the bar: its components are missing, or the azimuth of the swing is unknown.",
                "State mount and azimuth in the rig file, and log all components.";
            RigContradicted, "rig-contradicted", [Warning],
                "The data of a bench record contradict the part of its rig file that the text names. The rig file is \
                 used. Or the encoder slips or scatters, or a delay changed over the record. `bench` ends with exit \
                 code 3 if this marks channels of the card.",
                "Correct the rig file, or the cause of the scatter of the angle, and measure again.";
            EncoderRepaired, "encoder-repaired", [Warning, Info],
                "The encoder wrapped around and was unwrapped, or single samples, a dead part, or all but the liveliest \
                 part between slips are not used.",
                "Check cable and encoder.";
        }
        "Export and recover" {
            ValuesReplaced, "values-replaced", [Info, Warning],
                "The log lacks a value or a log time that the written file must have, or a value cannot be written \
                 as it is. For a missing value a placeholder is written, with `_given` false. For a missing log \
                 time, the text states which time is used, for example that of a neighbour. In CSV, U+2400 replaces \
                 zero bytes.",
                "Use the `_given` fields to distinguish placeholders from values. Use the timestamps in the fields \
                 where the order matters. Export as Parquet to keep zero bytes.";
            NotWritten, "not-written", [Loss, Warning],
                "Something was read, but not written. It is a warning if fields have no column because they are \
                 variable-length arrays or have more than 64 elements. Messages that could not be written are a \
                 loss.",
                "For fields, use `flightlag recover`: it copies complete messages of MCAP files and ROS bags. For \
                 messages, look at the topic that the place gives, and report it.";
        }
    }
    alarms {
        DelaySteps, "delay-steps", Red, "The delay jumps between levels.",
            "Do not remove a constant delay. Look for changes of the link or of the receiver at the jumps.";
        DelaySwitches, "delay-switches", Red, "The delay switches between two levels.",
            "Do not remove a constant delay. Find the part of the system that has two states.";
        DelayDrifts, "delay-drifts", Red, "The delay drifts: two clocks run at different rates.",
            "Use the timestamps of one clock, or synchronise the clocks.";
        DelayQueues, "delay-queues", Red, "The delay grows and empties again, as in a queue.",
            "Lower the data rate, or use timestamps of the measurement.";
        DelayBuildsUp, "delay-builds-up", Red, "The delay grows and does not empty again.",
            "Lower the data rate, or use timestamps of the measurement.";
        DelayWanders, "delay-wanders", Red, "The delay changes slowly, without a pattern.",
            "Do not remove a constant delay. Use timestamps of the measurement.";
        TwoDelaysFit, "two-delays-fit", Red, "Two delays fit the flight equally well.",
            "Fly a manoeuvre with changes of speed and direction that do not repeat.";
        LeapSecond, "leap-second", Red, "The delay steps by a whole second: a clock was set, or applied a leap \
            second.",
            "Split the log at the step.";
        OtherTimeScale, "other-time-scale", Red, "Position and velocity are 12.5 to 19 s apart, like GPS time and UTC.",
            "Correct the time scale of one channel in the channel map.";
        LogDamaged, "log-damaged", Red,
            "The loss of the log is more than minor. The text gives the amount and the place. Raised by `delay`.",
            "See `damaged`. Copy the log again.";
        PairsDisagree, "pairs-disagree", Amber, "Pairs of channels contradict each other, and no single channel \
            explains it.",
            "Look at the table of pairs. Add a reference file, or a third channel.";
        ChannelLies, "channel-lies", Amber, "One pair contradicts all others and is excluded.",
            "Look at the channel that the text names.";
        DatumRefused, "datum-refused", Amber, "A channel is earlier than the IMU, so the IMU cannot be the datum.",
            "Check the timestamps of the IMU.";
        DelayJitters, "delay-jitters", Amber, "The delay scatters from fix to fix.",
            "Use timestamps of the measurement instead of the arrival.";
        LateFixes, "late-fixes", Amber, "Single fixes are far later than the others.",
            "Look at the load of the link at these times.";
        Bursts, "bursts", Amber, "Fixes arrive in bursts after a pause: they were queued.",
            "Use timestamps of the measurement instead of the arrival.";
        Outliers, "outliers", Amber, "More than 5 % of the samples are outliers.",
            "Look at the residuals on the page of the flight.";
        DelayDoubtful, "delay-doubtful", Amber, "The residuals, a comparison of slow with fast motion, or a change against the IMU do not fit \
            one pure delay. The text says how.",
            "Look at the named check on the page of the flight.";
        OtherReceiver, "other-receiver", Amber, "Another position of the log has another lateness. The text gives it.",
            "Set the delay of each receiver. A parameter that serves all receivers suits only one of them.";
        ParameterDiffers, "parameter-differs", Amber, "A parameter of the autopilot states a delay, and the position is on time or early. \
            The autopilot removes a delay that is not there.",
            "Correct the parameter, or check that it is meant for this receiver.";
        ReferenceNotUsed, "reference-not-used", Amber,
            "The reference file was not used. The text gives the reason. The exit code is 3.",
            "Correct what the text names: day, clock or columns of the reference file.";
        ReferenceContradicted, "reference-contradicted", Amber,
            "A velocity or the IMU is early by more than 20 ms against the reference, or the IMU is late by more than 50 ms. \
             Nothing is measured before it happens, and an IMU is on time to some milliseconds, so the clock of the reference is \
             off, or the IMU is late. The reference does not judge the removal.",
            "Check the clock of the reference. Let it be measured: leave out `--reference-clock same`.";
        CardNotUsed, "card-not-used", Amber,
            "The delay of the sensor card was asked for and does not apply to this flight, so nothing was removed. The text gives the \
             reason.",
            "Use a card that has the channel which the text names, or another source of the delay.";
        DelayDiffersBetweenParts, "delay-differs-between-parts", Grey,
            "The delay differs between parts of the flight by less than the limit for a change.", "Nothing.";
        DelayWindowsScatter, "delay-windows-scatter", Grey,
            "The windows of the delay scatter by more than their uncertainties. The text says whether a change was looked for. U \
             includes the scatter.",
            "Nothing.";
        DelayRemark, "delay-remark", Grey,
            "A fact about the delay: the change that would have been seen, a slow trend, an antenna offset, or a restriction that U \
             includes.",
            "Nothing.";
        Companion, "companion", Grey,
            "The file has no position of its own vehicle, so it is not a flight. The text says what it holds.", "Nothing.";
    }
}
