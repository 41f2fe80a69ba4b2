//! The least that reading a ROS 2 bag with SQLite costs: stepping over the rows of the wanted topics and touching
//! every blob, nothing decoded: `db3_stepping BAG.db3 [TOPIC ...]`, no topic for all.
//!
//! The yardstick that `read_topics` is held against.
#![allow(clippy::print_stdout)]

use rusqlite::{Connection, OpenFlags};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: db3_stepping BAG.db3 [TOPIC ...]")?;
    let topics: Vec<String> = arguments.collect();
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI;
    let connection = Connection::open_with_flags(format!("file:{path}?immutable=1"), flags)?;
    let mut named = connection.prepare("SELECT id, name FROM topics")?;
    let ids = named.query_map([], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?)))?;
    let mut wanted = vec![];
    for entry in ids {
        let (id, name) = entry?;
        if topics.is_empty() || topics.contains(&name) {
            wanted.push(id.to_string());
        }
    }
    let sql = format!("SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({})", wanted.join(","));
    let mut statement = connection.prepare(&sql)?;
    let mut rows = statement.query([])?;
    let (mut count, mut bytes, mut sum) = (0_u64, 0, 0_i64);
    while let Some(row) = rows.next()? {
        let data = row.get_ref(2)?.as_blob()?;
        sum = sum.wrapping_add(row.get::<_, i64>(1)?).wrapping_add(i64::from(data.iter().fold(0_u8, |a, b| a ^ b)));
        count += 1;
        bytes += data.len();
    }
    println!("{count} rows, {bytes} bytes, {sum}");
    Ok(())
}
