//! A whole campaign on this machine: plan, make missing results, reduce.

use crate::error::CampaignError;
use crate::event::Event;
use crate::lock::OutputLock;
use crate::manifest::{Manifest, Stage};
use crate::plan::{Order, Retry, check_output, judge, plan};
use crate::reduce::{Reduction, Verdict, compare, reduce_locked, write_run};
use crate::run_context::RunContext;
use crate::source;
use crate::state::State;
use crate::store::Store;
use crate::study::{Replaying, Study};
use crate::task::{TaskReport, make};
use std::time::Instant;

/// Runs a campaign: reuses existing results, makes missing ones, and writes the pages.
///
/// # Errors
/// See [`CampaignError`]. An unreadable flight is not an error: it is a row of the table.
pub fn run(order: &Order, context: &RunContext<'_>) -> Result<Verdict, CampaignError> {
    run_with(order, context, &|manifest| Ok(Box::new(Replaying::prepare(manifest)?)))
}

/// Creates the study for a manifest.
pub(crate) type Prepare<'a> = &'a dyn Fn(&Manifest) -> Result<Box<dyn Study>, CampaignError>;

pub(crate) fn run_with(
    order: &Order,
    context: &RunContext<'_>,
    prepare: Prepare<'_>,
) -> Result<Verdict, CampaignError> {
    source::leaving_no_empty_folder(&order.out, || run_here(order, context, prepare))
}

fn run_here(order: &Order, context: &RunContext<'_>, prepare: Prepare<'_>) -> Result<Verdict, CampaignError> {
    let clock = (jiff::Timestamp::now(), Instant::now());
    let (store, _lock) = enter(order, context)?;
    let mut state = State::recall(&store);
    let round = |state: &mut State| round(order, context, &store, state, prepare);
    let (report, reduction) = round(&mut state)?;
    let (report, reduction) = match reduction {
        Reduction::Damaged(flights) => {
            let text = format!("computing damaged results again: {}", flights.join(", "));
            context.send(Event::Remark { text });
            round(&mut state)?
        }
        finished => (report, finished),
    };
    match reduction {
        Reduction::Finished(verdict) => {
            write_run(&store, context, clock, Some(report.made), &verdict)?;
            Ok(*verdict)
        }
        Reduction::Damaged(flights) => {
            let path = store.root().join("by-key");
            let what = format!("results changed after they were written: {}", flights.join(", "));
            Err(CampaignError::Table { path: path.display().to_string(), what })
        }
    }
}

/// Plan, measure, decide, replay, reduce, once.
fn round(
    order: &Order,
    context: &RunContext<'_>,
    store: &Store,
    state: &mut State,
    prepare: Prepare<'_>,
) -> Result<(TaskReport, Reduction), CampaignError> {
    compare(state, store, order.check(), context)?;
    let mut manifest = planned(order, context, store, state, 1)?;
    let mut report = TaskReport::default();
    if manifest.stale_count() > 0 {
        let study = prepare(&manifest)?;
        let to_measure = manifest.stale(Stage::Measure);
        if !to_measure.is_empty() {
            report.add(make(&to_measure, &manifest, study.as_ref(), store, context)?);
            judge(&mut manifest, &order.pipeline, store, state, Retry::Nobody)?;
            manifest.deal(1);
            report_plan(&manifest, context);
        }
        let to_replay = manifest.stale(Stage::Replay);
        if !to_replay.is_empty() {
            report.add(make(&to_replay, &manifest, study.as_ref(), store, context)?);
        }
    }
    Ok((report, reduce_locked(&manifest, context, store, state)?))
}

/// Plans a campaign for a cluster: at most `max_shards` shards of roughly equal size, all of one stage. Plan again
/// after their tasks, until a plan has no shards.
///
/// # Errors
/// See [`CampaignError`].
pub fn plan_shards(order: &Order, context: &RunContext<'_>, max_shards: u32) -> Result<Manifest, CampaignError> {
    source::leaving_no_empty_folder(&order.out, || {
        let (store, _lock) = enter(order, context)?;
        let mut state = State::recall(&store);
        compare(&mut state, &store, order.check(), context)?;
        planned(order, context, &store, &state, max_shards)
    })
}

/// Opens the output folder exclusively and removes leftovers of a killed run.
fn enter(order: &Order, context: &RunContext<'_>) -> Result<(Store, OutputLock), CampaignError> {
    check_output(order)?;
    let store = Store::open(&order.out)?;
    let lock = OutputLock::take(&store, context)?;
    let leftovers = store.clean();
    if leftovers > 0 {
        context.send(Event::Remark { text: format!("removed {leftovers} temporary files of a run that was killed") });
    }
    source::claim(&store, std::slice::from_ref(&order.flights))?;
    Ok((store, lock))
}

fn planned(
    order: &Order,
    context: &RunContext<'_>,
    store: &Store,
    state: &State,
    max_shards: u32,
) -> Result<Manifest, CampaignError> {
    let mut manifest = plan(order, context, store, state)?;
    manifest.deal(max_shards);
    for flight in manifest.flights.iter().filter(|f| f.stage.is_none() && f.key.is_some()) {
        context.send(Event::Reused { flight: flight.flight.clone() });
    }
    report_plan(&manifest, context);
    Ok(manifest)
}

fn report_plan(manifest: &Manifest, context: &RunContext<'_>) {
    let work = manifest.flights.iter().filter(|f| f.shard.is_some());
    context.send(Event::Planned {
        stage: manifest.stage(),
        flights: manifest.flights.len(),
        reused: manifest.flights.iter().filter(|f| f.stage.is_none() && f.key.is_some()).count(),
        to_run: manifest.stale_count(),
        bytes: work.map(|f| f.bytes()).sum(),
    });
}
