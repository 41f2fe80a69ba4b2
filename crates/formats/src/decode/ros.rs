//! Decodes ROS 1 and CDR (ROS 2) messages into columns.
//!
//! A definition and the wanted fields are compiled once into a list of operations; a message is then decoded in one
//! pass over that list. Unwanted fields are skipped: in one step if their size is constant. Neighbours of constant size
//! are read together, each at its own offset. CDR is the classic encoding (OMG XCDR 1, `DDSI-RTPS` 10.5) in either byte
//! order; XCDR 2 and parameter lists are rejected.

use crate::bytes::Bytes;
use crate::decode::Wanted;
use crate::decode::packed::number_of;
use crate::decode::rows::{Rows, Value, ValueType};
use crate::decode::schema::{Count, Dialect, Field, Kind, Number, Schema};

/// Elements read from a fixed array when everything is wanted.
pub(super) const MOST_ELEMENTS: u32 = 64;
/// Fixed arrays of messages up to this long have their size computed beforehand.
const MOST_MEASURED: u32 = 1024;
/// The most fields examined when everything is wanted: a definition can name exponentially many.
const MOST_VISITED: usize = 16_384;
/// CDR writers may pad the last word.
const CDR_PADDING: usize = 3;

/// Sizes in bytes by the phase (position modulo 8) at which the value starts. Without alignment all eight are equal.
type Sizes = [u64; 8];
const NOTHING: Sizes = [0; 8];

/// How to read the wanted fields of one message type.
#[derive(Debug)]
pub(crate) struct Plan {
    dialect: Dialect,
    steps: Vec<Step>,
    /// For each message type of the schema: how to skip one.
    over: Vec<Vec<Step>>,
    places: Vec<String>,
    /// Whether there is any text of wide characters.
    wide: bool,
    /// Arrays that are not read or not to their end, if all is wanted: `path[]`, `path[64..100]`.
    pub(crate) left_out: Vec<String>,
}

#[derive(Debug)]
struct Step {
    what: What,
    /// Index into [`Plan::places`].
    place: u32,
}

#[derive(Debug)]
enum What {
    Over(Sizes),
    Run(Run),
    Fixed { column: usize, what: Fixed },
    Text { column: usize },
    WideText { column: usize },
    OverMany { count: Option<u32>, element: Element },
    Array { count: Option<u32>, wanted: Vec<(u32, Vec<Step>)>, element: Element },
}

/// Neighbours of constant size. Most messages have all of them, in little-endian order: then only `reads` is used.
#[derive(Debug)]
struct Run {
    sizes: Sizes,
    reads: Vec<Read>,
    /// The same fields individually.
    steps: Vec<Step>,
}

/// A value at a known offset of a run.
#[derive(Debug)]
struct Read {
    column: usize,
    /// Bytes before it, by the phase at which the run starts.
    offsets: Sizes,
    what: Fixed,
}

/// A value of constant size.
#[derive(Debug, Clone, Copy)]
enum Fixed {
    Number(Number),
    Time(TimeSigns),
}

/// Which halves of a time are signed.
#[derive(Debug, Clone, Copy)]
struct TimeSigns {
    seconds: bool,
    nanos: bool,
}

impl TimeSigns {
    /// Nanoseconds; any 32 bits of seconds fit.
    fn nanos(self, seconds: u32, nanos: u32) -> i64 {
        let signed = |number: u32, sign| if sign { i64::from(number as i32) } else { i64::from(number) };
        signed(seconds, self.seconds) * flight::NANOS_PER_SECOND + signed(nanos, self.nanos)
    }
}

/// Something to skip.
#[derive(Debug, Clone, Copy)]
enum Element {
    Number(u64),
    Constant(Sizes),
    Text,
    WideText,
    Message(usize),
}

impl Plan {
    /// Compiles a plan; creates the columns in `rows`.
    pub(crate) fn new(schema: &Schema, wanted: &Wanted, rows: &mut Rows) -> Plan {
        let mut compiler = Compiler::new(schema);
        let over = (0..schema.messages.len()).map(|index| compiler.steps_over(index)).collect();
        let mut steps = vec![];
        compiler.message(0, "", wanted, rows, &mut steps);
        let wide = schema.messages.iter().flat_map(|m| &m.fields).any(|f| f.kind == Kind::WideText);
        Plan {
            dialect: schema.dialect,
            steps: in_runs(merged(steps), schema.dialect),
            over,
            places: compiler.places,
            wide,
            left_out: compiler.left_out,
        }
    }

    /// Sets the wanted values of the open row. Returns how many bytes the message has in excess of its definition.
    pub(crate) fn decode(&self, payload: &[u8], rows: &mut Rows) -> Result<usize, String> {
        if !self.wide {
            return self.decode_as(payload, 2, rows);
        }
        // Wide characters take two bytes with some middlewares and four with others: the whole message must fit.
        for unit in [2, 4] {
            if self.decode_as(payload, unit, rows) == Ok(0) {
                return Ok(0);
            }
            rows.roll_back();
        }
        self.decode_as(payload, 2, rows)
    }

    fn decode_as(&self, payload: &[u8], wide_unit: u64, rows: &mut Rows) -> Result<usize, String> {
        let mut walk = Walk { wide_unit, ..Walk::begin(self.dialect, payload)? };
        walk.steps(&self.steps, &self.over, rows).map_err(|fault| self.explain(fault))?;
        let left = walk.data.len() - walk.at;
        Ok(if self.dialect == Dialect::Ros2 && left <= CDR_PADDING { 0 } else { left })
    }

    /// Approximate memory use of the plan, bytes.
    pub(crate) fn weight(&self) -> usize {
        self.places.iter().map(|place| place.len() + 4 * size_of::<Step>()).sum()
    }

    fn explain(&self, fault: Fault) -> String {
        let place = self.places.get(fault.place as usize).map_or("", String::as_str);
        match fault.claimed {
            Some(count) => format!("{place}: a length of {count} does not fit in the message"),
            None => format!("{place}: the message ends inside it"),
        }
    }
}

struct Compiler<'s> {
    schema: &'s Schema,
    /// Size of each message type, `None` if it varies.
    sizes: Vec<Option<Sizes>>,
    places: Vec<String>,
    left_out: Vec<String>,
    visited: usize,
}

impl<'s> Compiler<'s> {
    fn new(schema: &'s Schema) -> Compiler<'s> {
        let sizes = vec![None; schema.messages.len()];
        let mut compiler = Compiler { schema, sizes, places: vec![], left_out: vec![], visited: 0 };
        // A message type comes before the types that it uses.
        for index in (0..schema.messages.len()).rev() {
            let sizes = compiler.measured(index);
            if let Some(place) = compiler.sizes.get_mut(index) {
                *place = sizes;
            }
        }
        compiler
    }

    fn fields(&self, message: usize) -> &'s [Field] {
        self.schema.messages.get(message).map_or(&[], |m| &m.fields)
    }

    fn measured(&self, message: usize) -> Option<Sizes> {
        let fields = self.fields(message);
        if fields.is_empty() && self.schema.dialect == Dialect::Ros2 {
            // IDL has no empty structure: it gets one octet.
            return Some([1; 8]);
        }
        let mut total = [0; 8];
        for field in fields {
            total = joined(total, self.field_sizes(field)?);
        }
        Some(total)
    }

    fn field_sizes(&self, field: &Field) -> Option<Sizes> {
        match (field.count, self.element(field.kind)) {
            (Count::Variable, _) => None,
            (Count::One, element) => element.sizes(self.schema.dialect, 1),
            (Count::Fixed(count), element) => element.sizes(self.schema.dialect, count),
        }
    }

    fn element(&self, kind: Kind) -> Element {
        match kind {
            Kind::Number(number) => Element::Number(number.size()),
            Kind::Text => Element::Text,
            Kind::WideText => Element::WideText,
            Kind::Time { .. } => Element::Constant(aligned_sizes(self.schema.dialect, 4, 8)),
            Kind::Message(index) => match self.sizes.get(index).copied().flatten() {
                Some(sizes) => Element::Constant(sizes),
                None => Element::Message(index),
            },
        }
    }

    fn place(&mut self, name: String) -> u32 {
        self.places.push(name);
        self.places.len() as u32 - 1
    }

    /// How to skip a message of varying size, field by field.
    fn steps_over(&mut self, message: usize) -> Vec<Step> {
        if self.sizes.get(message).is_some_and(Option::is_some) {
            return vec![];
        }
        let name = self.schema.messages.get(message).map_or("", |m| m.name.as_str());
        let steps = self.fields(message).iter().map(|f| self.step_over(f, format!("{name}.{}", f.name))).collect();
        merged(steps)
    }

    fn step_over(&mut self, field: &Field, path: String) -> Step {
        let place = self.place(path);
        if let Some(sizes) = self.field_sizes(field) {
            return Step { what: What::Over(sizes), place };
        }
        Step { what: What::OverMany { count: fixed_count(field.count), element: self.element(field.kind) }, place }
    }

    fn message(&mut self, message: usize, prefix: &str, wanted: &Wanted, rows: &mut Rows, steps: &mut Vec<Step>) {
        let fields = self.fields(message);
        if fields.is_empty() && self.schema.dialect == Dialect::Ros2 {
            let place = self.place(prefix.to_owned());
            steps.push(Step { what: What::Over([1; 8]), place });
        }
        for field in fields {
            let path = if prefix.is_empty() { field.name.clone() } else { format!("{prefix}.{}", field.name) };
            self.field(field, path, wanted, rows, steps);
        }
    }

    fn field(&mut self, field: &Field, path: String, wanted: &Wanted, rows: &mut Rows, steps: &mut Vec<Step>) {
        self.visited += 1;
        if self.visited > MOST_VISITED {
            let step = self.step_over(field, path);
            return steps.push(step);
        }
        match field.count {
            Count::One => self.one(field, path, wanted, rows, steps),
            Count::Fixed(_) | Count::Variable => self.array(field, path, wanted, rows, steps),
        }
    }

    fn one(&mut self, field: &Field, path: String, wanted: &Wanted, rows: &mut Rows, steps: &mut Vec<Step>) {
        if let Kind::Message(index) = field.kind {
            if wanted.below(&path) {
                return self.message(index, &path, wanted, rows, steps);
            }
            let step = self.step_over(field, path);
            return steps.push(step);
        }
        let step = match self.leaf(field.kind, &path, wanted, rows) {
            Some(what) => Step { what, place: self.place(path) },
            None => self.step_over(field, path),
        };
        steps.push(step);
    }

    /// How to read a wanted value that is not a message.
    fn leaf(&self, kind: Kind, path: &str, wanted: &Wanted, rows: &mut Rows) -> Option<What> {
        if !wanted.has(path) {
            return None;
        }
        Some(match kind {
            Kind::Number(number) => {
                let value_type =
                    if matches!(number, Number::I64 | Number::U64) { ValueType::Integer } else { ValueType::Float };
                What::Fixed { column: rows.column(path, value_type)?, what: Fixed::Number(number) }
            }
            Kind::Time { signed_seconds: seconds } => {
                // A duration of ROS 1 has signed nanoseconds as well; in ROS 2 they are always unsigned.
                let signs = TimeSigns { seconds, nanos: seconds && self.schema.dialect == Dialect::Ros1 };
                What::Fixed { column: rows.column(path, ValueType::Integer)?, what: Fixed::Time(signs) }
            }
            Kind::Text => What::Text { column: rows.column(path, ValueType::Text)? },
            Kind::WideText => What::WideText { column: rows.column(path, ValueType::Text)? },
            Kind::Message(_) => return None,
        })
    }

    fn array(&mut self, field: &Field, path: String, wanted: &Wanted, rows: &mut Rows, steps: &mut Vec<Step>) {
        let indexes = match field.count {
            Count::Fixed(count) => wanted.elements(&path, count.min(MOST_ELEMENTS)),
            Count::One | Count::Variable => wanted.elements(&path, 0),
        };
        match (wanted, field.count) {
            (Wanted::All, Count::Variable) => self.left_out.push(format!("{path}[]")),
            (Wanted::All, Count::Fixed(count)) if count > MOST_ELEMENTS => {
                self.left_out.push(format!("{path}[{MOST_ELEMENTS}..{count}]"));
            }
            _ => {}
        }
        let one = Field { name: field.name.clone(), kind: field.kind, count: Count::One };
        let mut read = vec![];
        for index in indexes {
            let mut steps = vec![];
            self.field(&one, format!("{path}[{index}]"), wanted, rows, &mut steps);
            read.push((index, steps));
        }
        if read.is_empty() {
            let step = self.step_over(field, path);
            return steps.push(step);
        }
        let (element, place, dialect) = (self.element(field.kind), self.place(path), self.schema.dialect);
        match field.count {
            Count::Fixed(count) if element.sizes(dialect, count).is_some() => {
                steps.extend(unrolled(count, element, read, dialect, place));
            }
            _ => {
                let wanted = read.into_iter().map(|(index, steps)| (index, in_runs(merged(steps), dialect))).collect();
                steps.push(Step { what: What::Array { count: fixed_count(field.count), wanted, element }, place });
            }
        }
    }
}

/// An array of known size, element by element.
fn unrolled(
    count: u32,
    element: Element,
    wanted: Vec<(u32, Vec<Step>)>,
    dialect: Dialect,
    place: u32,
) -> impl Iterator<Item = Step> {
    let mut next = 0;
    let mut over = move |until: u32| {
        let sizes = element.sizes(dialect, until - next).unwrap_or(NOTHING);
        next = until + 1;
        Step { what: What::Over(sizes), place }
    };
    let end = (count, vec![]);
    wanted
        .into_iter()
        .filter(move |(index, _)| *index < count)
        .chain(std::iter::once(end))
        .flat_map(move |(index, steps)| std::iter::once(over(index)).chain(steps))
}

fn fixed_count(count: Count) -> Option<u32> {
    match count {
        Count::One => Some(1),
        Count::Fixed(count) => Some(count),
        Count::Variable => None,
    }
}

fn aligned_sizes(dialect: Dialect, alignment: u64, size: u64) -> Sizes {
    match dialect {
        Dialect::Ros1 => [size; 8],
        Dialect::Ros2 => [0, 1, 2, 3, 4, 5, 6, 7].map(|phase| padding(phase, alignment) + size),
    }
}

fn padding(position: u64, alignment: u64) -> u64 {
    position.wrapping_neg() % alignment.max(1)
}

fn at_phase(sizes: &Sizes, position: u64) -> u64 {
    sizes.get((position % 8) as usize).copied().unwrap_or_default()
}

/// The sizes of one thing followed by another.
fn joined(first: Sizes, second: Sizes) -> Sizes {
    let mut both = first;
    for (phase, size) in both.iter_mut().enumerate() {
        *size = size.saturating_add(at_phase(&second, (phase as u64).wrapping_add(*size)));
    }
    both
}

impl Element {
    /// Size of `count` of these; `None` if it varies or is not worth computing.
    fn sizes(self, dialect: Dialect, count: u32) -> Option<Sizes> {
        match self {
            Element::Constant(NOTHING) => Some(NOTHING),
            _ if count == 0 => Some(NOTHING),
            Element::Number(size) => Some(aligned_sizes(dialect, size, size.saturating_mul(count.into()))),
            Element::Constant(sizes) if dialect == Dialect::Ros1 => {
                Some(sizes.map(|size| size.saturating_mul(count.into())))
            }
            Element::Constant(sizes) if count <= MOST_MEASURED => {
                Some((1..count).fold(sizes, |total, _| joined(total, sizes)))
            }
            _ => None,
        }
    }
}

/// Merges adjacent skips into one step.
fn merged(steps: Vec<Step>) -> Vec<Step> {
    let mut short: Vec<Step> = vec![];
    for step in steps {
        if let What::Over(sizes) = &step.what
            && let Some(Step { what: What::Over(before), .. }) = short.last_mut()
        {
            *before = joined(*before, *sizes);
        } else {
            short.push(step);
        }
    }
    short
}

/// Merges neighbours of constant size into one step.
fn in_runs(steps: Vec<Step>, dialect: Dialect) -> Vec<Step> {
    let mut short: Vec<Step> = vec![];
    for step in steps {
        match (short.last_mut(), step.size(dialect)) {
            (Some(Step { what: What::Run(run), .. }), Some(sizes)) => run.push(step, sizes),
            (_, Some(sizes)) => {
                let place = step.place;
                let mut run = Run { sizes: NOTHING, reads: vec![], steps: vec![] };
                run.push(step, sizes);
                short.push(Step { what: What::Run(run), place });
            }
            (_, None) => short.push(step),
        }
    }
    // A log may have tens of thousands of topics, each with its own plan.
    for step in &mut short {
        if let What::Run(run) = &mut step.what {
            run.steps.shrink_to_fit();
            run.reads.shrink_to_fit();
        }
    }
    short.shrink_to_fit();
    short
}

impl Step {
    /// `None` if it varies.
    fn size(&self, dialect: Dialect) -> Option<Sizes> {
        match &self.what {
            What::Over(sizes) => Some(*sizes),
            What::Fixed { what, .. } => {
                let (alignment, size) = what.alignment_and_size();
                Some(aligned_sizes(dialect, alignment, size))
            }
            _ => None,
        }
    }
}

impl Run {
    fn push(&mut self, step: Step, sizes: Sizes) {
        self.sizes = joined(self.sizes, sizes);
        if let What::Fixed { column, what } = step.what {
            let (_, size) = what.alignment_and_size();
            self.reads.push(Read { column, offsets: self.sizes.map(|end| end.saturating_sub(size)), what });
        }
        self.steps.push(step);
    }
}

impl Fixed {
    fn alignment_and_size(self) -> (u64, u64) {
        match self {
            Fixed::Number(number) => (number.size(), number.size()),
            Fixed::Time(_) => (4, 8),
        }
    }

    /// The value at the start of little-endian bytes; `None` for a number that no column can hold.
    #[inline(always)]
    fn value(self, bytes: &[u8]) -> Option<Value<'static>> {
        match self {
            Fixed::Number(number) => number_of(number, bytes),
            Fixed::Time(signs) => {
                let mut bytes = Bytes(bytes);
                Some(Value::Integer(signs.nanos(bytes.u32()?, bytes.u32()?)))
            }
        }
    }
}

/// Why decoding stopped: the message ended, or a length in it is impossible.
#[derive(Debug, Clone, Copy)]
struct Fault {
    place: u32,
    claimed: Option<u32>,
}

struct Walk<'p> {
    data: &'p [u8],
    at: usize,
    aligned: bool,
    big_endian: bool,
    /// Bytes of a wide character.
    wide_unit: u64,
}

impl<'p> Walk<'p> {
    fn begin(dialect: Dialect, payload: &'p [u8]) -> Result<Walk<'p>, String> {
        if dialect == Dialect::Ros1 {
            return Ok(Walk { data: payload, at: 0, aligned: false, big_endian: false, wide_unit: 2 });
        }
        let (head, data) =
            payload.split_first_chunk::<4>().ok_or("the message is shorter than its encapsulation header")?;
        match *head {
            [0, 0, ..] => Ok(Walk { data, at: 0, aligned: true, big_endian: true, wide_unit: 2 }),
            [0, 1, ..] => Ok(Walk { data, at: 0, aligned: true, big_endian: false, wide_unit: 2 }),
            [0, 2 | 3, ..] => Err("CDR parameter lists are not supported".to_owned()),
            [0, kind @ 6..=11, ..] => Err(format!("XCDR2 (encapsulation 0x{kind:04x}) is not supported yet")),
            [high, low, ..] => Err(format!("encapsulation 0x{high:02x}{low:02x} is not CDR")),
        }
    }

    fn steps(&mut self, steps: &[Step], over: &[Vec<Step>], rows: &mut Rows) -> Result<(), Fault> {
        for step in steps {
            self.step(step, over, rows)?;
        }
        Ok(())
    }

    fn step(&mut self, step: &Step, over: &[Vec<Step>], rows: &mut Rows) -> Result<(), Fault> {
        let short = Fault { place: step.place, claimed: None };
        match &step.what {
            What::Over(sizes) => self.forward(at_phase(sizes, self.at as u64)).ok_or(short),
            What::Run(run) => self.run(run, over, rows),
            What::Fixed { column, what } => {
                rows.set(*column, self.fixed(*what).ok_or(short)?);
                Ok(())
            }
            What::Text { column } => {
                let text = self.text(step.place)?;
                rows.set(*column, Value::Text(&text));
                Ok(())
            }
            What::WideText { column } => {
                let text = self.wide_text(step.place)?;
                rows.set(*column, Value::Text(&text));
                Ok(())
            }
            What::OverMany { count, element } => {
                let count = self.count(*count).ok_or(short)?;
                self.over(count, *element, over, step.place)
            }
            What::Array { count, wanted, element } => {
                let count = self.count(*count).ok_or(short)?;
                self.array(count, wanted, *element, over, rows, step.place)
            }
        }
    }

    fn run(&mut self, run: &Run, over: &[Vec<Step>], rows: &mut Rows) -> Result<(), Fault> {
        let phase = self.at % 8;
        let size = usize::try_from(at_phase(&run.sizes, self.at as u64)).ok();
        let end = size.and_then(|size| self.at.checked_add(size));
        let bytes = end.and_then(|end| self.data.get(self.at..end)).filter(|_| !self.big_endian);
        let Some(bytes) = bytes else { return self.steps(&run.steps, over, rows) };
        for Read { column, offsets, what } in &run.reads {
            let from = bytes.get(at_phase(offsets, phase as u64) as usize..).unwrap_or_default();
            if let Some(value) = what.value(from) {
                rows.set(*column, value);
            }
        }
        self.at += bytes.len();
        Ok(())
    }

    fn array(
        &mut self,
        count: u32,
        wanted: &[(u32, Vec<Step>)],
        element: Element,
        over: &[Vec<Step>],
        rows: &mut Rows,
        place: u32,
    ) -> Result<(), Fault> {
        let mut next = 0;
        for (index, steps) in wanted.iter().filter(|(index, _)| *index < count) {
            self.over(index - next, element, over, place)?;
            self.steps(steps, over, rows)?;
            next = index + 1;
        }
        self.over(count - next, element, over, place)
    }

    /// Skips `count` elements. Stops early on hostile counts, because every element takes at least one byte.
    fn over(&mut self, count: u32, element: Element, over: &[Vec<Step>], place: u32) -> Result<(), Fault> {
        if count == 0 || matches!(element, Element::Constant(NOTHING)) {
            return Ok(());
        }
        let too_many = Fault { place, claimed: Some(count) };
        match element {
            Element::Number(size) => {
                self.align(size).ok_or(too_many)?;
                self.forward(size.saturating_mul(count.into())).ok_or(too_many)
            }
            Element::Constant(sizes) if !self.aligned => {
                self.forward(at_phase(&sizes, 0).saturating_mul(count.into())).ok_or(too_many)
            }
            Element::Constant(sizes) => self.each(count, |walk| {
                let size = at_phase(&sizes, walk.at as u64);
                walk.forward(size).ok_or(too_many)
            }),
            Element::Text => self.each(count, |walk| walk.prefixed(1, place).map(|_| ())),
            Element::WideText => self.each(count, |walk| walk.prefixed(walk.wide_unit, place).map(|_| ())),
            Element::Message(index) => {
                let steps = over.get(index).map_or(&[][..], Vec::as_slice);
                self.each(count, |walk| walk.steps_over(steps, over))
            }
        }
    }

    fn each(&mut self, count: u32, mut one: impl FnMut(&mut Self) -> Result<(), Fault>) -> Result<(), Fault> {
        (0..count).try_for_each(|_| one(self))
    }

    fn steps_over(&mut self, steps: &[Step], over: &[Vec<Step>]) -> Result<(), Fault> {
        for step in steps {
            let short = Fault { place: step.place, claimed: None };
            match &step.what {
                What::Over(sizes) => self.forward(at_phase(sizes, self.at as u64)).ok_or(short)?,
                What::OverMany { count, element } => {
                    let count = self.count(*count).ok_or(short)?;
                    self.over(count, *element, over, step.place)?;
                }
                // Skipping reads no values.
                What::Run(_) | What::Fixed { .. } | What::Text { .. } | What::WideText { .. } | What::Array { .. } => {}
            }
        }
        Ok(())
    }

    fn forward(&mut self, bytes: u64) -> Option<()> {
        let at = usize::try_from(bytes).ok().and_then(|n| self.at.checked_add(n))?;
        (at <= self.data.len()).then(|| self.at = at)
    }

    fn align(&mut self, alignment: u64) -> Option<()> {
        if self.aligned { self.forward(padding(self.at as u64, alignment)) } else { Some(()) }
    }

    fn u32(&mut self) -> Option<u32> {
        self.align(4)?;
        let bytes = *self.data.get(self.at..)?.first_chunk()?;
        self.at += 4;
        Some(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn number(&mut self, number: Number) -> Option<Value<'static>> {
        self.align(number.size())?;
        let start = self.at;
        self.forward(number.size())?;
        let mut little = [0; 8];
        let bytes = little.get_mut(..self.at - start)?;
        bytes.copy_from_slice(self.data.get(start..self.at)?);
        if self.big_endian {
            bytes.reverse();
        }
        number_of(number, &little)
    }

    fn fixed(&mut self, what: Fixed) -> Option<Value<'static>> {
        match what {
            Fixed::Number(number) => self.number(number),
            Fixed::Time(signs) => Some(Value::Integer(signs.nanos(self.u32()?, self.u32()?))),
        }
    }

    fn count(&mut self, fixed: Option<u32>) -> Option<u32> {
        fixed.or_else(|| self.u32())
    }

    /// Bytes after a count of units.
    fn prefixed(&mut self, unit: u64, place: u32) -> Result<&'p [u8], Fault> {
        let count = self.u32().ok_or(Fault { place, claimed: None })?;
        let start = self.at;
        self.forward(unit * u64::from(count)).ok_or(Fault { place, claimed: Some(count) })?;
        Ok(self.data.get(start..self.at).unwrap_or_default())
    }

    fn text(&mut self, place: u32) -> Result<std::borrow::Cow<'p, str>, Fault> {
        let bytes = self.prefixed(1, place)?;
        // CDR counts the terminating zero; ROS 1 has none.
        let bytes = if self.aligned { bytes.strip_suffix(&[0]).unwrap_or(bytes) } else { bytes };
        Ok(String::from_utf8_lossy(bytes))
    }

    /// UTF-16, with the writer's number of bytes for each unit.
    fn wide_text(&mut self, place: u32) -> Result<String, Fault> {
        let bytes = self.prefixed(self.wide_unit, place)?;
        let number = |unit: &[u8]| {
            let digit = |sum: u32, byte: &u8| sum << 8 | u32::from(*byte);
            if self.big_endian { unit.iter().fold(0, digit) } else { unit.iter().rev().fold(0, digit) }
        };
        let units = bytes.chunks(self.wide_unit as usize).map(|unit| u16::try_from(number(unit)).unwrap_or(0xfffd));
        let mut units: Vec<u16> = units.collect();
        if units.last() == Some(&0) {
            units.pop();
        }
        Ok(String::from_utf16_lossy(&units))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{Table, TopicInfo};

    /// Writes fields one by one according to the OMG rules; alignment counts from the end of the header.
    struct Writer {
        bytes: Vec<u8>,
        aligned: bool,
        big_endian: bool,
    }

    impl Writer {
        fn ros1() -> Writer {
            Writer { bytes: vec![], aligned: false, big_endian: false }
        }

        fn cdr(big_endian: bool) -> Writer {
            Writer { bytes: vec![0, u8::from(!big_endian), 0, 0], aligned: true, big_endian }
        }

        fn raw<const N: usize>(mut self, little: [u8; N]) -> Writer {
            while self.aligned && !(self.bytes.len() - 4).is_multiple_of(N) {
                self.bytes.push(0xaa);
            }
            let mut bytes = little;
            if self.big_endian {
                bytes.reverse();
            }
            self.bytes.extend(bytes);
            self
        }

        fn u8(self, x: u8) -> Writer {
            self.raw([x])
        }

        fn u32(self, x: u32) -> Writer {
            self.raw(x.to_le_bytes())
        }

        fn f64(self, x: f64) -> Writer {
            self.raw(x.to_le_bytes())
        }

        fn text(self, x: &str) -> Writer {
            let end = u32::from(self.aligned);
            let mut with_length = self.u32(x.len() as u32 + end);
            with_length.bytes.extend(x.as_bytes());
            with_length.bytes.extend(vec![0; end as usize]);
            with_length
        }
    }

    fn decode(text: &str, dialect: Dialect, wanted: &Wanted, payload: &[u8]) -> Result<(Table, usize), String> {
        let schema = Schema::parse("p/A", text, dialect)?;
        let mut rows = Rows::default();
        let plan = Plan::new(&schema, wanted, &mut rows);
        let beyond = plan.decode(payload, &mut rows)?;
        rows.close(0, None, 1);
        Ok((rows.into_table(TopicInfo::default()), beyond))
    }

    fn numbers(table: &Table) -> Vec<(&str, Option<f64>)> {
        table.columns.iter().map(|c| (c.path.as_str(), c.number(0))).collect()
    }

    const POSE: &str = "Stamp head\nuint8 flag\nfloat64 x\nint16[3] small\nuint8[] blob\nPart[2] parts\nPart[] more\n\
        float64 last\n===\nMSG: p/Stamp\nstring frame\nuint8 level\n===\nMSG: p/Part\nuint8 a\nfloat64 b";

    fn pose(start: Writer) -> Vec<u8> {
        let aligned = start.aligned;
        let mut w = start.text("map").u8(3).u8(1).f64(2.5);
        for small in [-1_i16, 7, 300] {
            w = w.raw(small.to_le_bytes());
        }
        w = w.u32(5);
        w.bytes.extend([9; 5]);
        for (a, b) in [(1, 0.1), (2, 0.2)] {
            w = w.u8(a).f64(b);
        }
        w = w.u32(3);
        for (a, b) in [(3, 0.3), (4, 0.4), (5, 0.5)] {
            w = w.u8(a).f64(b);
        }
        let bytes = w.f64(-8.0).bytes;
        assert!(aligned || bytes.len() == 4 + 3 + 2 + 8 + 6 + 9 + 18 + 4 + 27 + 8);
        bytes
    }

    #[test]
    fn every_encoding_of_a_message_gives_the_same_columns() {
        let wanted = Wanted::of_paths([
            "head.level",
            "x",
            "small[2]",
            "parts[1].b",
            "more[0].a",
            "more[2].b",
            "more[3].b",
            "last",
        ]);
        let expected = [
            ("head.level", Some(3.0)),
            ("last", Some(-8.0)),
            ("more[0].a", Some(3.0)),
            ("more[2].b", Some(0.5)),
            ("parts[1].b", Some(0.2)),
            ("small[2]", Some(300.0)),
            ("x", Some(2.5)),
        ];
        for (dialect, bytes) in [
            (Dialect::Ros1, pose(Writer::ros1())),
            (Dialect::Ros2, pose(Writer::cdr(false))),
            (Dialect::Ros2, pose(Writer::cdr(true))),
        ] {
            let (table, beyond) = decode(POSE, dialect, &wanted, &bytes).unwrap();
            assert_eq!(numbers(&table), expected, "{dialect:?}");
            assert_eq!(beyond, 0);
        }
    }

    #[test]
    fn each_field_decodes_alone_as_it_does_among_all() {
        // Skipped fields must be skipped by the right number of bytes.
        for (dialect, bytes) in [(Dialect::Ros1, pose(Writer::ros1())), (Dialect::Ros2, pose(Writer::cdr(false)))] {
            let (all, _) = decode(POSE, dialect, &Wanted::All, &bytes).unwrap();
            assert_eq!(all.columns.len(), 12);
            for column in &all.columns {
                let (one, beyond) = decode(POSE, dialect, &Wanted::of_paths([column.path.as_str()]), &bytes).unwrap();
                assert_eq!((one.columns.as_slice(), beyond), (std::slice::from_ref(column), 0));
            }
        }
    }

    #[test]
    fn a_message_truncated_anywhere_is_rejected_with_its_last_field() {
        for (dialect, bytes) in [(Dialect::Ros1, pose(Writer::ros1())), (Dialect::Ros2, pose(Writer::cdr(true)))] {
            for length in 0..bytes.len() {
                for wanted in [Wanted::All, Wanted::of_paths(["last"]), Wanted::of_paths([])] {
                    let error = decode(POSE, dialect, &wanted, &bytes[..length]).unwrap_err();
                    assert!(error.contains(": ") || error.contains("encapsulation"), "{error}");
                }
            }
        }
        let error = decode(POSE, Dialect::Ros1, &Wanted::All, &[3, 0, 0, 0, b'm', b'a', b'p']).unwrap_err();
        assert_eq!(error, "head.level: the message ends inside it");
    }

    #[test]
    fn hostile_lengths_are_rejected_at_once_with_their_field() {
        let bytes = Writer::ros1().u32(u32::MAX).bytes;
        for (text, wanted) in [
            ("string s", Wanted::All),
            ("string s", Wanted::of_paths([])),
            ("float64[] s", Wanted::of_paths(["s[4000000000]"])),
            ("B[] s\n===\nMSG: p/B\nstring t", Wanted::of_paths([])),
            ("B[] s\n===\nMSG: p/B\nuint8 t", Wanted::of_paths(["s[1].t"])),
        ] {
            let error = decode(text, Dialect::Ros1, &wanted, &bytes).unwrap_err();
            assert!(
                error.starts_with("s") || error.starts_with("p/A.s") || error.starts_with("p/B.t"),
                "{text}: {error}"
            );
        }
        let bytes = Writer::cdr(false).u32(u32::MAX).bytes;
        assert!(decode("B[] s\n===\nMSG: p/B\nuint8 t\nfloat64 u", Dialect::Ros2, &Wanted::All, &bytes).is_err());
    }

    #[test]
    fn four_billion_elements_of_nothing_take_no_time() {
        let nothing = "B[] a\nB[4294967295] b\n===\nMSG: p/B\nuint8[0] c";
        let bytes = Writer::ros1().u32(u32::MAX).bytes;
        assert_eq!(decode(nothing, Dialect::Ros1, &Wanted::of_paths([]), &bytes).unwrap().1, 0);
        let bytes = Writer::cdr(false).u32(u32::MAX).bytes;
        assert_eq!(decode(nothing, Dialect::Ros2, &Wanted::of_paths([]), &bytes).unwrap().1, 0);
    }

    #[test]
    fn times_become_nanoseconds_and_durations_may_be_negative() {
        let bytes = Writer::ros1().u32(4_000_000_000).u32(999_999_999).u32(-2_i32 as u32).u32(500_000_000).bytes;
        let (table, _) = decode("time t\nduration d", Dialect::Ros1, &Wanted::All, &bytes).unwrap();
        assert_eq!(table.column("t").unwrap().integer(0), Some(4_000_000_000_999_999_999));
        assert_eq!(table.column("d").unwrap().integer(0), Some(-1_500_000_000));
        // roslib/msgs: "duration: secs/nsecs signed 32-bit ints"; writers need not normalise them.
        let bytes = Writer::ros1().u32(0).u32(-20_000_000_i32 as u32).bytes;
        let (table, _) = decode("duration d", Dialect::Ros1, &Wanted::All, &bytes).unwrap();
        assert_eq!(table.column("d").unwrap().integer(0), Some(-20_000_000));
        let bytes = Writer::cdr(false).u8(1).u32(-1_i32 as u32).u32(1).bytes;
        let text = "uint8 a\nbuiltin_interfaces/Time t";
        let (table, _) = decode(text, Dialect::Ros2, &Wanted::of_paths(["t"]), &bytes).unwrap();
        assert_eq!(table.column("t").unwrap().integer(0), Some(-999_999_999));
    }

    #[test]
    fn integers_of_64_bits_are_exact_with_and_without_sign() {
        let bytes = Writer::ros1().raw(u64::MAX.to_le_bytes()).raw(i64::MIN.to_le_bytes()).bytes;
        let (table, _) = decode("uint64 u\nint64 i", Dialect::Ros1, &Wanted::All, &bytes).unwrap();
        assert_eq!(table.column("u").unwrap().unsigned(0), Some(u64::MAX));
        assert_eq!(table.column("i").unwrap().integer(0), Some(i64::MIN));
    }

    #[test]
    fn text_loses_only_the_terminating_zero_of_cdr() {
        for (dialect, bytes) in [
            (Dialect::Ros1, Writer::ros1().text("a\u{e9}b").bytes),
            (Dialect::Ros2, Writer::cdr(false).text("a\u{e9}b").bytes),
        ] {
            let (table, _) = decode("string s", dialect, &Wanted::All, &bytes).unwrap();
            assert_eq!(table.column("s").unwrap().text(0), Some("a\u{e9}b"));
        }
        // Some writers encode an empty text as no bytes at all.
        let (table, _) = decode("string s", Dialect::Ros2, &Wanted::All, &Writer::cdr(false).u32(0).bytes).unwrap();
        assert_eq!(table.column("s").unwrap().text(0), Some(""));
    }

    #[test]
    fn an_empty_message_takes_no_bytes_in_ros_1_and_one_octet_in_ros_2() {
        let text = "Nothing n\nfloat64 x\n===\nMSG: p/Nothing\n";
        let (table, beyond) = decode(text, Dialect::Ros1, &Wanted::All, &Writer::ros1().f64(1.5).bytes).unwrap();
        assert_eq!((numbers(&table), beyond), (vec![("x", Some(1.5))], 0));
        let (table, beyond) =
            decode(text, Dialect::Ros2, &Wanted::All, &Writer::cdr(false).u8(0).f64(1.5).bytes).unwrap();
        assert_eq!((numbers(&table), beyond), (vec![("x", Some(1.5))], 0));
    }

    #[test]
    fn an_empty_sequence_of_doubles_is_not_padded() {
        let bytes = Writer::cdr(false).u32(0).u32(7).bytes;
        let (table, beyond) = decode("float64[] a\nuint32 b", Dialect::Ros2, &Wanted::All, &bytes).unwrap();
        assert_eq!((numbers(&table), beyond), (vec![("b", Some(7.0))], 0));
    }

    #[test]
    fn excess_bytes_are_counted_except_cdr_padding() {
        let (_, beyond) = decode("uint8 a", Dialect::Ros1, &Wanted::All, &[1, 2, 3]).unwrap();
        assert_eq!(beyond, 2);
        let bytes = |more: usize| [vec![0, 1, 0, 0, 9], vec![0; more]].concat();
        assert_eq!(decode("uint8 a", Dialect::Ros2, &Wanted::All, &bytes(3)).unwrap().1, 0);
        assert_eq!(decode("uint8 a", Dialect::Ros2, &Wanted::All, &bytes(4)).unwrap().1, 4);
    }

    #[test]
    fn other_encapsulations_are_rejected_by_name() {
        for (kind, word) in [([0, 7], "XCDR2"), ([0, 3], "parameter lists"), ([1, 1], "not CDR"), ([0, 12], "not CDR")]
        {
            let bytes = [kind[0], kind[1], 0, 0, 1, 2, 3, 4];
            let error = decode("uint8 a", Dialect::Ros2, &Wanted::All, &bytes).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn a_definition_that_names_exponentially_many_fields_stays_small() {
        let mut text = (0..10).map(|i| format!("T0 f{i}\n")).collect::<String>();
        for level in 0..20 {
            text += &format!("===\nMSG: p/T{level}\n");
            text += &(0..10).map(|i| format!("T{} f{i}\n", level + 1)).collect::<String>();
        }
        text += "===\nMSG: p/T20\nuint8[] blob\n";
        let schema = Schema::parse("p/A", &text, Dialect::Ros1).unwrap();
        let plan = Plan::new(&schema, &Wanted::All, &mut Rows::default());
        assert!(plan.weight() < 20 << 20, "{}", plan.weight());
        assert!(plan.decode(&[0; 1000], &mut Rows::default()).is_err());
    }

    #[test]
    fn only_the_first_elements_of_a_large_fixed_array_are_read() {
        let bytes: Vec<u8> = (0..100_u32).flat_map(|i| f64::from(i).to_le_bytes()).collect();
        let (table, beyond) = decode("float64[100] a", Dialect::Ros1, &Wanted::All, &bytes).unwrap();
        assert_eq!((table.columns.len(), beyond), (64, 0));
        assert_eq!(table.column("a[63]").unwrap().number(0), Some(63.0));
        let (table, _) = decode("float64[100] a", Dialect::Ros1, &Wanted::of_paths(["a[99]"]), &bytes).unwrap();
        assert_eq!(table.column("a[99]").unwrap().number(0), Some(99.0));
    }

    #[test]
    fn wide_text_is_read_with_two_or_four_bytes_per_character() {
        for (unit, big_endian) in [(2, false), (4, false), (2, true), (4, true)] {
            let mut writer = Writer::cdr(big_endian).u8(1).u32(3);
            for character in "a\u{e9}\u{4e2d}".encode_utf16() {
                writer = if unit == 2 { writer.raw(character.to_le_bytes()) } else { writer.u32(character.into()) };
            }
            let bytes = writer.f64(2.5).bytes;
            let (table, beyond) = decode("uint8 a\nwstring w\nfloat64 x", Dialect::Ros2, &Wanted::All, &bytes).unwrap();
            assert_eq!(table.column("w").unwrap().text(0), Some("a\u{e9}\u{4e2d}"), "{unit} {big_endian}");
            assert_eq!((table.column("x").unwrap().number(0), beyond), (Some(2.5), 0));
        }
    }
}
