//! The connections of a bag: the type of its messages and their topics.

use super::bag_record::Fields;
use crate::decode::{Definition, MD5_OF_NOTHING, Route, Tally, Times, Topics};
use crate::format::report_unplaced;
use crate::reader::Extra;
use crate::table::TopicInfo;
use flight::{Code, Notices};
use logscan::Fate;
use std::collections::HashMap;

/// Maximum connections in one bag.
const MOST_CONNECTIONS: usize = 65_536;
/// Maximum memory for the definitions of a bag, bytes.
const MOST_DEFINITIONS: usize = 64 << 20;

struct Connection {
    info: TopicInfo,
    definition: Option<Vec<u8>>,
    md5sum: Option<String>,
    route: Route,
}

/// Connections of one bag; routes messages to the topics.
pub(super) struct Connections<'b, 't> {
    topics: &'b mut Topics<'t>,
    known: HashMap<u32, Connection>,
    definition_bytes: usize,
    unplaced: Tally,
    redefined: Tally,
}

impl<'b, 't> Connections<'b, 't> {
    pub(super) fn new(topics: &'b mut Topics<'t>) -> Connections<'b, 't> {
        let (unplaced, redefined) = Default::default();
        Connections { topics, known: HashMap::new(), definition_bytes: 0, unplaced, redefined }
    }

    /// Takes a connection record. Its `data` are a second header with the definition. The error says what is wrong.
    pub(super) fn announce(&mut self, id: u32, topic: &[u8], data: &[u8]) -> Result<(), String> {
        let fields = Fields::parse(data).ok_or("the fields of a connection are damaged")?;
        let type_name = fields.text("type").ok_or("a connection without a type")?;
        let definition = fields.get("message_definition").unwrap_or_default();
        let md5sum = fields.text("md5sum");
        let is_whole = !definition.is_empty() || md5sum.as_deref() == Some(MD5_OF_NOTHING);
        let name = String::from_utf8_lossy(topic).into_owned();
        let beside = ["callerid", "latching", "md5sum"].iter();
        let entries = beside.filter_map(|name| Some(((*name).to_owned(), fields.text(name)?))).collect();
        self.topics.extra(&Extra::OfTopic { topic: &name, entries: &entries });
        let info = TopicInfo { name, type_name, encoding: "ros1".to_owned() };
        self.add(id, info, is_whole.then_some(definition), md5sum)
    }

    /// `definition` is absent if the recorder had none; the definition of a message without fields is an empty text.
    fn add(
        &mut self,
        id: u32,
        info: TopicInfo,
        definition: Option<&[u8]>,
        md5sum: Option<String>,
    ) -> Result<(), String> {
        if let Some(known) = self.known.get(&id) {
            if known.info == info && known.definition.as_deref() == definition && known.md5sum == md5sum {
                return Ok(());
            }
            self.redefined.add(|| format!("connection {id}, {:.200}", info.name));
            // If there is no room for the new connection, its messages must not go to the old one.
            self.known.remove(&id);
        }
        self.definition_bytes += definition.map_or(0, <[u8]>::len);
        if self.known.len() >= MOST_CONNECTIONS || self.definition_bytes > MOST_DEFINITIONS {
            return Err(format!(
                "the bag has more than {MOST_CONNECTIONS} connections or {MOST_DEFINITIONS} bytes of definitions"
            ));
        }
        let text = definition.map(|text| Definition { encoding: "ros1msg", text });
        let route = self.topics.route_with_sum(info.clone(), text, md5sum.as_deref())?;
        self.known.insert(id, Connection { info, definition: definition.map(<[u8]>::to_vec), md5sum, route });
        Ok(())
    }

    pub(super) fn knows(&self, id: u32) -> bool {
        self.known.contains_key(&id)
    }

    pub(super) fn wants(&self, id: u32) -> bool {
        self.known.get(&id).is_some_and(|known| known.route.is_wanted())
    }

    pub(super) fn message(&mut self, id: u32, logged_ns: i64, payload: &[u8]) -> Fate {
        match self.known.get(&id) {
            Some(known) if known.route.is_wanted() => {
                self.topics.message(known.route, Times { logged_ns, published_ns: None }, payload)
            }
            _ => self.unread(id, logged_ns, payload.len() as u64),
        }
    }

    /// Counts an unwanted message whose payload was not read.
    pub(super) fn unread(&mut self, id: u32, logged_ns: i64, length: u64) -> Fate {
        let Some(known) = self.known.get(&id) else {
            self.unplaced.add(|| format!("connection {id}"));
            return Fate::Skipped;
        };
        self.topics.unread(known.route, Times { logged_ns, published_ns: None }, length)
    }

    /// Reports oddities. Returns the number of messages without a connection.
    pub(super) fn end(self, file: &str, notices: &mut Notices) -> u64 {
        report_unplaced(&self.unplaced, file, notices);
        self.redefined.report(
            Code::Redefined,
            file,
            "connections were replaced by others with the same number",
            notices,
        );
        self.unplaced.count
    }
}
