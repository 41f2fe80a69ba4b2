//! Queries of a history: which rows, grouped by what, and which aggregates of each group.
//!
//! ```text
//! condition  = or ;  or = and { "or" and } ;  and = one { "and" one }
//! one        = "not" one | "(" or ")" | column operator value | column "is" [ "not" ] "null"
//! operator   = "==" | "!=" | "<" | "<=" | ">" | ">="
//! value      = number | 'text' | "text"
//! aggregates = aggregate { "," aggregate } ;  aggregate = "count()" | name "(" column ")" | "quantile(" column "," share ")"
//! ```
//!
//! A comparison with an absent value is neither true nor false: such a row matches neither the query nor its
//! negation. `is null` finds it.

use crate::error::HistoryError;
use crate::row::{COLUMNS, sheet_of};
use convert::Cells;

/// An alias, and its column.
const ALSO_CALLED: [(&str, &str); 3] = [("delay_s", "lateness_s"), ("delay_u_s", "lateness_u_s"), ("rate", "rate_hz")];

/// A query of a history.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Query {
    /// Rows that match; `None` for all.
    pub(crate) condition: Option<Condition>,
    /// Columns by which rows are grouped.
    pub(crate) by: Vec<String>,
    /// Aggregates of each group; without any, the answer is the rows themselves.
    pub(crate) aggregates: Vec<Aggregate>,
    /// Use every row of every run, not only the latest of each flight.
    pub(crate) every_run: bool,
}

/// Which rows match.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Condition {
    /// Compares a column with a value.
    Compare {
        column: String,
        operator: Operator,
        value: Value,
    },
    /// Whether a value is absent.
    IsNull {
        column: String,
    },
    Not(Box<Condition>),
    And(Box<Condition>, Box<Condition>),
    Or(Box<Condition>, Box<Condition>),
}

/// A comparison operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Operator {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

/// The value that a column is compared with.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    Integer(i64),
    Text(String),
}

/// An aggregate of a group.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Aggregate {
    /// As written: the column name in the answer.
    pub(crate) name: String,
    pub(crate) function: Function,
    /// `None` for a count of rows.
    pub(crate) column: Option<String>,
}

/// An aggregate function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Function {
    Count,
    Median,
    Mean,
    Min,
    Max,
    Std,
    Sum,
    Quantile(f64),
}

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Integer,
    Number,
    Text,
}

impl Query {
    /// Parses a query as written on the command line.
    ///
    /// # Errors
    /// States what is wrong, where, and what would be right.
    pub fn parse(
        condition: Option<&str>,
        by: &[String],
        aggregates: Option<&str>,
        every_run: bool,
    ) -> Result<Query, HistoryError> {
        let by =
            by.iter().map(|name| known_column(name).map_err(|what| asked("--by", &what))).collect::<Result<_, _>>()?;
        let condition = condition.map(parse_condition).transpose().map_err(|what| asked("condition", &what))?;
        let aggregates = aggregates.map_or(Ok(vec![]), parse_aggregates).map_err(|what| asked("--agg", &what))?;
        Ok(Query { condition, by, aggregates, every_run })
    }

    /// Columns needed for the answer; all of them if the answer is rows.
    #[cfg(any(test, feature = "query"))]
    pub(crate) fn columns(&self) -> Vec<&str> {
        if self.by.is_empty() && self.aggregates.is_empty() {
            return COLUMNS.iter().map(|(name, _)| *name).collect();
        }
        let mut names: Vec<&str> = self.by.iter().map(String::as_str).collect();
        names.extend(self.aggregates.iter().filter_map(|aggregate| aggregate.column.as_deref()));
        if let Some(condition) = &self.condition {
            condition.add_columns(&mut names);
        }
        names.extend(["campaign", "flight", "run_ns"]);
        names.sort_unstable();
        names.dedup();
        names
    }
}

impl Condition {
    #[cfg(any(test, feature = "query"))]
    fn add_columns<'a>(&'a self, names: &mut Vec<&'a str>) {
        match self {
            Condition::Compare { column, .. } | Condition::IsNull { column } => names.push(column),
            Condition::Not(one) => one.add_columns(names),
            Condition::And(one, other) | Condition::Or(one, other) => {
                one.add_columns(names);
                other.add_columns(names);
            }
        }
    }
}

fn asked(part: &str, what: &str) -> HistoryError {
    HistoryError::Asked(format!("{part}: {what}"))
}

/// The column with this name.
fn known_column(name: &str) -> Result<String, String> {
    let name = ALSO_CALLED.iter().find(|(also, _)| *also == name).map_or(name, |(_, column)| column);
    if COLUMNS.iter().any(|(column, _)| *column == name) {
        return Ok(name.to_owned());
    }
    let all = || COLUMNS.iter().map(|(column, _)| *column).chain(ALSO_CALLED.iter().map(|(also, _)| *also));
    let near = settings::nearest_few(name, all(), 3).join(", ");
    Err(format!("no column {name:?}; the nearest are {near}"))
}

fn kind_of(column: &str) -> Kind {
    match sheet_of(&[]).cells(column) {
        Some(Cells::I64(_) | Cells::U64(_)) => Kind::Integer,
        Some(Cells::F64(_)) => Kind::Number,
        Some(Cells::Text(_)) | None => Kind::Text,
    }
}

/// A word of a condition and its position, in characters from 1.
#[derive(Debug, Clone, PartialEq)]
struct Token {
    at: usize,
    what: Word,
}

#[derive(Debug, Clone, PartialEq)]
enum Word {
    Name(String),
    Number(f64),
    Text(String),
    Sign(&'static str),
}

const SIGNS: [&str; 9] = ["==", "!=", "<=", ">=", "<", ">", "(", ")", ","];

fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let chars: Vec<char> = text.chars().collect();
    let mut all = vec![];
    let mut at = 0;
    while let Some(&c) = chars.get(at) {
        let begin = at;
        let run = |from: usize, is: &dyn Fn(char) -> bool| {
            (from..).take_while(|i| chars.get(*i).is_some_and(|c| is(*c))).count()
        };
        let what = if c.is_whitespace() {
            at += 1;
            continue;
        } else if c == '\'' || c == '"' {
            let length = run(at + 1, &|other| other != c);
            if chars.get(at + 1 + length).is_none() {
                return Err(format!("character {}: unterminated text; add {c}", begin + 1));
            }
            at += length + 2;
            Word::Text(chars[begin + 1..=begin + length].iter().collect())
        } else if c.is_ascii_digit() || "+-.".contains(c) {
            at += 1 + run(at + 1, &|c| c.is_ascii_alphanumeric() || ".+-".contains(c));
            let number: String = chars[begin..at].iter().collect();
            let wrong =
                |_| format!("character {}: {number:?} is not a number; units are those of the column", begin + 1);
            Word::Number(number.parse().map_err(wrong)?)
        } else if c.is_alphabetic() || c == '_' {
            at += run(at, &|c| c.is_alphanumeric() || c == '_');
            Word::Name(chars[begin..at].iter().collect())
        } else {
            let rest: String = chars[at..].iter().take(2).collect();
            let sign = SIGNS.iter().find(|sign| rest.starts_with(**sign));
            let sign = sign
                .ok_or_else(|| format!("character {}: unexpected {c:?}; comparisons are == != < <= > >=", begin + 1))?;
            at += sign.len();
            Word::Sign(sign)
        };
        all.push(Token { at: begin + 1, what });
    }
    Ok(all)
}

/// Deepest nesting of a condition.
const DEEPEST: usize = 100;

struct Parser {
    tokens: Vec<Token>,
    next: usize,
    depth: usize,
}

fn parse_condition(text: &str) -> Result<Condition, String> {
    let mut parser = Parser { tokens: tokens(text)?, next: 0, depth: 0 };
    let condition = parser.or()?;
    match parser.tokens.get(parser.next) {
        None => Ok(condition),
        Some(token) => Err(format!("character {}: expected `and` or `or`, found {}", token.at, shown(&token.what))),
    }
}

fn shown(word: &Word) -> String {
    match word {
        Word::Name(name) => name.clone(),
        Word::Number(number) => number.to_string(),
        Word::Text(text) => format!("{text:?}"),
        Word::Sign(sign) => (*sign).to_owned(),
    }
}

impl Parser {
    fn take(&mut self, expected: &str) -> Result<Token, String> {
        let token = self.tokens.get(self.next).cloned().ok_or_else(|| format!("at the end: expected {expected}"))?;
        self.next += 1;
        Ok(token)
    }

    /// Consumes a word if it comes next.
    fn is_next(&mut self, word: &str) -> bool {
        let is = match self.tokens.get(self.next).map(|token| &token.what) {
            Some(Word::Name(name)) => name.eq_ignore_ascii_case(word),
            Some(Word::Sign(sign)) => *sign == word,
            _ => false,
        };
        self.next += usize::from(is);
        is
    }

    fn or(&mut self) -> Result<Condition, String> {
        let mut all = self.and()?;
        while self.is_next("or") {
            all = Condition::Or(Box::new(all), Box::new(self.and()?));
        }
        Ok(all)
    }

    fn and(&mut self) -> Result<Condition, String> {
        let mut all = self.one()?;
        while self.is_next("and") {
            all = Condition::And(Box::new(all), Box::new(self.one()?));
        }
        Ok(all)
    }

    fn one(&mut self) -> Result<Condition, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("more than {DEEPEST} levels of `not` and parentheses"));
        }
        let one = if self.is_next("not") {
            Condition::Not(Box::new(self.one()?))
        } else if self.is_next("(") {
            let inner = self.or()?;
            if !self.is_next(")") {
                return Err("a `(` has no `)`".to_owned());
            }
            inner
        } else {
            self.comparison()?
        };
        self.depth -= 1;
        Ok(one)
    }

    fn comparison(&mut self) -> Result<Condition, String> {
        let token = self.take("a column")?;
        let Word::Name(name) = &token.what else {
            return Err(format!("character {}: expected a column, found {}", token.at, shown(&token.what)));
        };
        let column = known_column(name).map_err(|what| format!("character {}: {what}", token.at))?;
        if self.is_next("is") {
            let is_not = self.is_next("not");
            if !self.is_next("null") {
                return Err(format!("character {}: expected `is null` or `is not null`", token.at));
            }
            let null = Condition::IsNull { column };
            return Ok(if is_not { Condition::Not(Box::new(null)) } else { null });
        }
        let sign = self.take("a comparison, such as >")?;
        let operator = match &sign.what {
            Word::Sign("==") => Operator::Equal,
            Word::Sign("!=") => Operator::NotEqual,
            Word::Sign("<") => Operator::Less,
            Word::Sign("<=") => Operator::LessOrEqual,
            Word::Sign(">") => Operator::Greater,
            Word::Sign(">=") => Operator::GreaterOrEqual,
            other => {
                return Err(format!("character {}: expected a comparison, such as >, found {}", sign.at, shown(other)));
            }
        };
        let value = self.take("a number or a text in quotes")?;
        let at = value.at;
        let value = value_for(&column, value.what).map_err(|what| format!("character {at}: {what}"))?;
        Ok(Condition::Compare { column, operator, value })
    }
}

/// A value of the column's type. An instant may be a date.
fn value_for(column: &str, word: Word) -> Result<Value, String> {
    match (kind_of(column), word) {
        (Kind::Text, Word::Text(text)) => Ok(Value::Text(text)),
        (Kind::Text, other) => Err(format!("{column} holds text: put {} in quotes", shown(&other))),
        (Kind::Number, Word::Number(number)) => Ok(Value::Number(number)),
        (Kind::Integer, Word::Text(text)) if column.ends_with("_ns") => instant(&text).map(Value::Integer),
        (Kind::Integer, Word::Number(number)) if number.fract() == 0.0 && number.abs() < 9e18 => {
            Ok(Value::Integer(number as i64))
        }
        (Kind::Integer, Word::Number(number)) => Err(format!("{column} holds whole numbers, and {number} is not one")),
        (_, other) => Err(format!("{column} holds numbers, and {} is not one", shown(&other))),
    }
}

/// Nanoseconds since 1970 for `2026-05-04` or `2026-05-04T09:30:00Z`.
fn instant(text: &str) -> Result<i64, String> {
    let whole = if text.len() == 10 { format!("{text}T00:00:00Z") } else { text.to_owned() };
    crate::schema::nanoseconds(&whole).map_err(|_| {
        format!("{text:?} is neither a date, such as '2026-05-04', nor a time, such as '2026-05-04T09:30:00Z'")
    })
}

fn parse_aggregates(text: &str) -> Result<Vec<Aggregate>, String> {
    let mut parser = Parser { tokens: tokens(text)?, next: 0, depth: 0 };
    let mut all = vec![parser.aggregate()?];
    while parser.is_next(",") {
        all.push(parser.aggregate()?);
    }
    match parser.tokens.get(parser.next) {
        None => Ok(all),
        Some(token) => Err(format!("character {}: expected `,`, found {}", token.at, shown(&token.what))),
    }
}

impl Parser {
    fn aggregate(&mut self) -> Result<Aggregate, String> {
        let name = self.aggregate_name()?;
        if name == "count" {
            return match self.is_next(")") {
                true => Ok(Aggregate { name: "count()".to_owned(), function: Function::Count, column: None }),
                false => Err("count() counts rows and takes no column".to_owned()),
            };
        }
        let of = self.take("a column")?;
        let column = column_of_numbers(&of, &name)?;
        let share = if name == "quantile" { Some(self.share()?) } else { None };
        if !self.is_next(")") {
            return Err(format!("{name}( has no `)`"));
        }
        let function = match (name.as_str(), share) {
            ("median", _) => Function::Median,
            ("mean", _) => Function::Mean,
            ("min", _) => Function::Min,
            ("max", _) => Function::Max,
            ("std", _) => Function::Std,
            ("sum", _) => Function::Sum,
            (_, share) => Function::Quantile(share.unwrap_or(0.5)),
        };
        let name = share.map_or_else(
            || format!("{name}({})", shown(&of.what)),
            |share| format!("{name}({}, {share})", shown(&of.what)),
        );
        Ok(Aggregate { name, function, column: Some(column) })
    }

    /// The name of an aggregate and its opening parenthesis.
    fn aggregate_name(&mut self) -> Result<String, String> {
        const KNOWN: [&str; 8] = ["count", "median", "mean", "min", "max", "std", "sum", "quantile"];
        let token = self.take("an aggregate, such as count()")?;
        let Word::Name(written) = &token.what else {
            return Err(format!("character {}: expected an aggregate, found {}", token.at, shown(&token.what)));
        };
        let name = written.to_ascii_lowercase();
        if !KNOWN.contains(&name.as_str()) {
            return Err(format!("character {}: no aggregate {written:?}; there are {}", token.at, KNOWN.join(", ")));
        }
        if self.is_next("(") {
            return Ok(name);
        }
        let column = if name == "count" { "" } else { "lateness_s" };
        Err(format!("character {}: {name} needs parentheses, such as {name}({column})", token.at))
    }

    fn share(&mut self) -> Result<f64, String> {
        let wrong = "quantile takes a column and a share from 0 to 1, such as quantile(lateness_s, 0.9)";
        if !self.is_next(",") {
            return Err(wrong.to_owned());
        }
        match self.take("a share from 0 to 1")?.what {
            Word::Number(share) if (0.0..=1.0).contains(&share) => Ok(share),
            _ => Err(wrong.to_owned()),
        }
    }
}

fn column_of_numbers(of: &Token, aggregate: &str) -> Result<String, String> {
    let wrong = |what: String| format!("character {}: {what}", of.at);
    let column = match &of.what {
        Word::Name(column) => known_column(column).map_err(wrong)?,
        other => return Err(wrong(format!("expected a column, found {}", shown(other)))),
    };
    match kind_of(&column) {
        Kind::Text => Err(wrong(format!("{column} holds text, and {aggregate} needs numbers"))),
        _ => Ok(column),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(condition: &str) -> Condition {
        parse_condition(condition).unwrap()
    }

    #[test]
    fn and_binds_tighter_than_or_and_names_have_aliases() {
        let Condition::Or(one, other) = parsed("delay_s > 0.3 and firmware == '3.01' or not baud is null") else {
            panic!()
        };
        let Condition::And(first, _) = *one else { panic!() };
        let expected =
            Condition::Compare { column: "lateness_s".into(), operator: Operator::Greater, value: Value::Number(0.3) };
        assert_eq!(*first, expected);
        assert_eq!(*other, Condition::Not(Box::new(Condition::IsNull { column: "baud".into() })));
        assert_eq!(parsed("(delay_s>0.3)"), expected);
    }

    #[test]
    fn a_date_is_an_instant() {
        let Condition::Compare { value, .. } = parsed("flown_ns >= '2026-05-04'") else { panic!() };
        assert_eq!(value, Value::Integer(1_777_852_800_000_000_000));
    }

    #[test]
    fn errors_state_their_position_and_the_correction() {
        let wrong = |text: &str| parse_condition(text).unwrap_err();
        assert!(wrong("latenes_s > 1").starts_with("character 1: no column \"latenes_s\"; the nearest are lateness_s"));
        assert_eq!(wrong("firmware == 3.01"), "character 13: firmware holds text: put 3.01 in quotes");
        assert_eq!(wrong("delay_s > 'x'"), "character 11: lateness_s holds numbers, and \"x\" is not one");
        assert_eq!(wrong("delay_s >"), "at the end: expected a number or a text in quotes");
        assert_eq!(wrong("delay_s = 1"), "character 9: unexpected '='; comparisons are == != < <= > >=");
        assert_eq!(wrong("delay_s > 1 2"), "character 13: expected `and` or `or`, found 2");
        assert_eq!(wrong("delay_s > 300ms"), "character 11: \"300ms\" is not a number; units are those of the column");
        assert_eq!(wrong("firmware == 'x"), "character 13: unterminated text; add '");
        assert!(wrong(&"not ".repeat(200)).contains("more than 100 levels"));
        let wrong = |text: &str| parse_aggregates(text).unwrap_err();
        assert!(wrong("avg(delay_s)").contains("there are count, median, mean"));
        assert_eq!(wrong("median(firmware)"), "character 8: firmware holds text, and median needs numbers");
        assert!(wrong("quantile(delay_s)").contains("quantile(lateness_s, 0.9)"));
    }

    #[test]
    fn aggregates_keep_the_name_that_was_written() {
        let all = parse_aggregates("median(delay_s), count(), quantile(delay_s, 0.9)").unwrap();
        assert_eq!(
            all.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(),
            ["median(delay_s)", "count()", "quantile(delay_s, 0.9)"]
        );
        assert_eq!(all[0].column.as_deref(), Some("lateness_s"));
        let query = Query { aggregates: all, by: vec!["firmware".into()], ..Query::default() };
        assert_eq!(query.columns(), ["campaign", "firmware", "flight", "lateness_s", "run_ns"]);
    }
}
