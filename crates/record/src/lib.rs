//! The second waist of the architecture: results as versioned, serialised types without arithmetic.
//!
//! A [`FlightRecord`] holds everything that an analysis found about one flight: its page can be drawn from it years
//! later without the log. A [`CampaignRecord`] is the list of flights of one run. A [`BenchRecord`] holds everything
//! that a bench found about a sensor. A [`SensorCard`] carries the bench results to the flights. Times are in seconds,
//! lengths in metres, angles in radians unless a name says otherwise. `None` means that the number does not exist,
//! never that it is zero.
//!
//! ```
//! use record::Estimate;
//! let error = Estimate { value: 0.037, standard_uncertainty: Some(0.002) };
//! let text = serde_json::to_string(&error).unwrap();
//! assert_eq!(serde_json::from_str::<Estimate>(&text).unwrap(), error);
//! ```

mod bench;
mod campaign;
mod card;
mod changes;
mod criteria;
mod delay_network;
mod delay_over_time;
mod doubt;
mod ekf;
mod explorer;
mod flight;
mod flight_delay;
mod group;
mod json;
mod lateness;
mod night;
mod reference_file;
mod replay;
mod score;
mod sweep;
mod test_card;

pub use crate::bench::{
    BenchFindings, BenchLog, BenchOutcome, BenchRecord, ChannelDynamics, ClockFinding, ComponentDynamics, DelayFinding,
    Finding, FitChecks, Flexibility, GateCheck, HullFinding, Injection, LatencyHistogram, MagnetometerFinding,
    ModelCandidate, ModelFinding, MountCheck, MountFinding, NoiseFinding, ObjectiveCurve, Overlay, PpsFinding,
    QualityGate, Recovery, ReferenceFinding, ResponseFinding, ResponsePoint, RigGeometry, RigPart, RigUse, ShiftCurve,
    Stationarity, TimeBasis, Verdict, WanderTaken,
};
pub use crate::campaign::{CampaignRecord, CampaignTotals, FlightRow, IgnoredInput};
pub use crate::card::{
    CARD_VERSION, CardChannel, CardMagnetometer, CardSource, CardUse, IronCalibration, MOVING_AVERAGE, SensorCard,
    SensorIdentity,
};
pub use crate::changes::{CampaignChanges, MadeWith, MovedDelay, RerunFlight, TroubleChange, in_the_past};
pub use crate::criteria::{
    CampaignCriteria, CriteriaUse, CriterionFinding, CriterionSummary, CriterionUnit, CriterionVerdict, DecisionRule,
    FlightCriteria, Limit, PassRate, RowVerdict, RowVerdicts, VerdictTally,
};
pub use crate::delay_network::{
    ChannelLateness, DelayNetwork, DelayPool, EffectKind, EffectName, FlightsDiffer, GroupSplit, NetworkDatum,
    NetworkEffect, NetworkVerdict, PoolMean, PoolMember, RemovedDelay, UnusedPair, UsedPair, is_one_sided,
};
pub use crate::delay_over_time::{
    Burst, Constancy, CurvePoint, DelayJitter, DelayKind, DelayOverTime, DelayTerm, DelayTermKind, LateFix,
};
pub use crate::doubt::{
    COUNTS_OR_STAMPS_WRONG, DELAY_CHANGES, ENCODER_RESIDUAL, ENCODER_SIGN, ENCODER_SLIP, SIDE_OF_PIVOT,
};
pub use crate::ekf::{EkfChannel, EkfValue, EkfValueKind, EkfValues};
pub use crate::explorer::{ExplorerColumn, ExplorerRows};
pub use crate::flight::{FlightRecord, InputFile, Outcome, PipelineUse};
pub use crate::flight_delay::{
    DelayExcitation, DelayGroup, DelayHomogeneity, DelayNoise, DelayOrigin, DelayPairKind, DelayPiece, DelaySplit,
    DelayStep, FlightDelays, FlightInjection, MeasuredDelay, PairDelay, WindowDelay, is_filter_output,
};
pub use crate::group::{DuplicateFlight, FlightContent, GroupPart, ReceiverGroup};
pub use crate::lateness::{
    CardDelay, Decision, DelayAdvice, DelayAlarm, DelaySetting, Effect, EffectVerdict, FlightLateness, Gravity,
    GroupLateness, JudgedBy, MeasuredFlight, OtherReceiver, counted_from, flight_alarms,
};
pub use crate::night::{
    ChangeCause, ComparedReport, DiffRecord, FlightWords, LeftLog, MovedAdvice, MovedNumber, NamedFlight,
    NewTrendChange, NightCampaign, NightGroup, NightRecord, ProofVerdict, RerunCause, RunChanges, SettingProof,
    TrendChange, TrendChart, TrendPoint, TrendRecord, TrendSegment,
};
pub use crate::reference_file::{ClockOffset, ReferenceClock, ReferenceFile};
pub use crate::replay::{
    AxisCurves, CompensatorResult, Coverage, Curve, Estimate, Lead, LeadCurves, LeadTrack, PairUse, ReplayRecord,
    ReplaySettings, StartRule, Zoom,
};
pub use crate::score::{
    BudgetTerm, CompensatorScore, ErrorBudget, HelpfulBand, Hysteresis, MotionSpectrum, OnboardAgainst,
    OnboardComparison, OppositePasses, ReferenceScore, ReplayScores, ResidualDelay, StraightLegs, StraightScore,
};
pub use crate::sweep::{
    CampaignDelay, ControlPoint, DelayCandidate, DelayChoice, DelayDifference, DelayOverFlights, DelaySource,
    DelaySweep, FlightHomogeneity, PooledSweep, SweepMethod, SweepOptimum, SweepPoint, SweepScore,
};
pub use crate::test_card::{
    CampaignTest, CardCoverage, CardFlight, CardStatus, FlightTest, FlownCard, RowCard, TestAircraft, TestCard,
    TestCardSource, TestConditions, TestInstrument, TestReport,
};

/// Version of the schema of these records: raised when the meaning of a field changes.
pub const RECORD_VERSION: u32 = 1;
