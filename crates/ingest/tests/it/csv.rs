//! Dialects and faults of text tables, with exact expectations.

use crate::support::*;
use flight::{LogHealth, Severity};
use ingest::{ColumnData, FieldRequest, Limits, Log, LogError, Selection, TopicInfo, ValueKind};

fn read_limited(text: &[u8], selection: &Selection, limits: Limits) -> Result<Log, LogError> {
    let (_folder, path) = file("t.csv", text);
    let want = |_: &TopicInfo| selection.clone();
    let log = read_files(limits, ingest::LogKind::Csv, &[path], &want)?;
    assert_sum(&log.health, text.len());
    Ok(log)
}

fn assert_sum(health: &LogHealth, size: usize) {
    let b = &health.bytes;
    assert_eq!((b.size, b.sum()), (size as u64, size as u64), "{b:?}");
}

fn read(text: &str) -> Log {
    read_limited(text.as_bytes(), &Selection::All, Limits::default()).unwrap()
}

fn numbers(log: &Log, path: &str) -> Vec<Option<f64>> {
    let table = &log.tables[0];
    let column = table.column(path).unwrap_or_else(|| panic!("no {path} in {table:?}"));
    (0..table.rows).map(|row| column.number(row)).collect()
}

/// Columns `t` and `x` of two rows: the same in every dialect.
fn assert_plain(text: &str, what: &str) {
    let log = read(text);
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(2.0)], "{what}");
    assert_eq!(numbers(&log, "x"), [Some(0.5), Some(-1.5e-3)], "{what}");
    assert_eq!((log.health.messages, log.health.undecodable, log.health.bytes.damaged), (2, 0, 0), "{what}");
    assert_eq!(log.tables[0].columns.len(), 2, "{what}");
}

#[test]
fn the_same_table_in_every_dialect_is_the_same_table() {
    for (what, text) in [
        ("plain", "t,x\n1,0.5\n2,-1.5e-3\n"),
        ("CR LF", "t,x\r\n1,0.5\r\n2,-1.5e-3\r\n"),
        ("CR CR LF", "t,x\r\r\n1,0.5\r\r\n2,-1.5e-3\r\r\n"),
        ("CR", "t,x\r1,0.5\r2,-1.5e-3\r"),
        ("mixed line ends", "t,x\n1,0.5\r\n2,-1.5e-3\r"),
        ("semicolons", "t;x\n1;0.5\n2;-1.5e-3\n"),
        ("TAB", "t\tx\n1\t0.5\n2\t-1.5e-3\n"),
        ("bars", "t|x\n1|0.5\n2|-1.5e-3\n"),
        ("bars with padding", "t | x\n1 | 0.5\n2 | -1.5e-3\n"),
        ("units in words", "t,x\nsec,meters per second\n1,0.5\n2,-1.5e-3\n"),
        ("units in words and none for one", "t,x\n-,m s-1\n1,0.5\n2,-1.5e-3\n"),
        ("byte order mark", "\u{feff}t,x\n1,0.5\n2,-1.5e-3\n"),
        ("padding", "  t ,  x\n 1 , 0.5 \n   2, -1.5E-03\n"),
        ("quotes", "\"t\",\"x\"\n\"1\",\"0.5\"\n2,\"-1.5e-3\"\n"),
        ("comments", "# made by hand\nt,x\n# first\n1,0.5\n2,-1.5e-3\n# end\n"),
        ("empty lines", "\nt,x\n\n1,0.5\n  \n2,-1.5e-3\n\n"),
        ("delimiter at the end of every line", "t,x,\n1,0.5,\n2,-1.5e-3,\n"),
        ("delimiter at the end of the rows", "t,x\n1,0.5,\n2,-1.5e-3,\n"),
        ("delimiter at the end of the header", "t,x,\n1,0.5\n2,-1.5e-3\n"),
        ("units in brackets", "t,x\n[s],[m/s]\n1,0.5\n2,-1.5e-3\n"),
        ("units in parentheses, one empty", "t,x\n,(m/s)\n1,0.5\n2,-1.5e-3\n"),
        ("plain units", "t,x\ns,m/s\n1,0.5\n2,-1.5e-3\n"),
        ("header in a comment", "# t, x\n1,0.5\n2,-1.5e-3\n"),
        ("lines before the header", "Report of today\nt,x\n1,0.5\n2,-1.5e-3\n"),
    ] {
        assert_plain(text, what);
    }
}

/// A fixed sequence of numbers.
fn drawn(seed: u64) -> impl FnMut(usize) -> usize {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    }
}

#[test]
fn a_lines_fate_does_not_depend_on_a_quote_far_after_it() {
    // Before a quote every line is parsed on its own, elsewhere in blocks of rows.
    const ODD: [&str; 16] = [
        "",
        "  ",
        "# 1,2,3",
        "//1,2,3",
        "t,a,b",
        "t,7,8",
        ",2,3",
        " ,2,3",
        "1,2",
        "1,2,3,",
        "1,2,3,4",
        "-,2,3",
        "1,,3",
        "1,x,nan",
        "\t1 , 2,3 ",
        "/,2,3",
    ];
    for (seed, delimiter) in (0..400).zip([",", ";", "\t", ", "].into_iter().cycle()) {
        let mut draw = drawn(seed);
        let rare = 2 + draw(40);
        let mut text = "t,a,b\n1,2.5,3\n2,2.5,3\n3,2.5,3\n4,2.5,3\n5,2.5,3\n".to_owned();
        for row in 0..60 + draw(100) {
            let plain = || format!("{row},{}.{},{}", row % 7, "9".repeat(row % 19), row * row);
            text += &if draw(rare) == 0 { ODD[draw(ODD.len())].to_owned() } else { plain() };
            text += if draw(rare) == 0 { ["\r", "\r\r\n", "\r\n", "\n\r"][draw(4)] } else { "\n" };
        }
        let text = text.replace(',', delimiter);
        let [plain, one_by_one] = ["# 'end'\n", "# \"end\"\n"].map(|end| read(&format!("{text}{end}")));
        assert_eq!(plain.tables, one_by_one.tables, "{seed}");
        assert_eq!(plain.health.bytes, one_by_one.health.bytes, "{seed}");
        let notices = |log: &Log| log.notices.iter().cloned().collect::<Vec<_>>();
        assert_eq!(notices(&plain), notices(&one_by_one), "{seed}");
        assert!(plain.tables[0].rows > 20, "{seed}");
    }
}

/// A large table with an unusual row in every `rare`.
fn large_table(seed: u64, rare: usize) -> String {
    let mut draw = drawn(seed);
    let cell = |row: usize, column: usize| match column {
        0 => (1_700_000_000_000_000_000 + row as u64 * 5_000_000).to_string(),
        1 => format!("{}.{:06}", row % 500, row * 7919 % 1_000_000),
        2 => (row * row % 1000).to_string(),
        _ => ["up", "down", "level, or so"][row / 3 % 2].to_owned(),
    };
    let mut text = "stamp,lat,count,word\n".to_owned();
    let mut row = 0;
    while text.len() < 2_600_000 {
        row += 1;
        let mut cells: Vec<String> = (0..4).map(|column| cell(row, column)).collect();
        let place = draw(4);
        if draw(rare) == 0 {
            const ODD: [&str; 13] = [
                "",
                "nan",
                "N/A",
                "x",
                "2.5",
                "17",
                "-",
                "9007199254740993",
                "1e300",
                "\"a,b\"",
                "\"a\nb\"",
                "\0",
                "5\" pipe",
            ];
            const LINES: [&str; 9] =
                ["# a remark", "", "  ", "1,2", "1,2,3,4,5,6", "stamp,lat,count,word", "\"open,1,2,3", "\r", ","];
            match draw(5) {
                0 | 1 => cells[place] = ODD[draw(ODD.len())].to_owned(),
                2 => text += &format!("{}\n", LINES[draw(LINES.len())]),
                // Another header, and the first again.
                3 if draw(3) == 0 => text += "lat,stamp,word,count\n7,1,up,3\nstamp,lat,count,word\n",
                3 => text += &format!("{}\n", "7,".repeat(100 + draw(9000))),
                _ => cells[place] = "\0".repeat(draw(20_000)),
            }
        }
        text += &cells.join(",");
        text += if draw(rare) == 0 { ["\r", "\r\r\n", "\n\r"][draw(3)] } else { "\n" };
    }
    if seed % 3 == 1 {
        // Searched for to the end of the file.
        text += "\"never closed,1,2,3\n";
        (0..40).for_each(|row| text += &format!("{}\n", [0, 1, 2, 3].map(|column| cell(row, column)).join(",")));
    }
    text.truncate(text.len() - draw(30));
    text
}

#[test]
fn a_large_table_is_the_same_to_one_thread_and_to_many() {
    use ValueKind::{Number, Text};
    let wants = [("stamp", Number), ("lat", Number), ("count", Number), ("word", Text), ("count", Text)];
    let fields = wants.map(|(path, kind)| FieldRequest { path: path.to_owned(), kind }).to_vec();
    let pools = [1, 2, 4].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    for (seed, rare) in (0..12).zip([3, 40, 1000, 20_000, 300_000].into_iter().cycle()) {
        let text = large_table(seed, rare);
        // Lines longer than this many bytes are rejected.
        let limits = Limits { line_bytes: [1 << 20, 15_000][seed as usize % 2], ..Limits::default() };
        let wanted = Selection::Fields(fields.iter().skip(seed as usize / 2 % 3).cloned().collect());
        let [one, two, four] = pools.each_ref().map(|pool| {
            let log = pool.install(|| read_limited(text.as_bytes(), &wanted, limits)).unwrap();
            assert!(log.tables[0].rows > 1000, "{seed}");
            (log.health.clone(), log.notices.iter().cloned().collect::<Vec<_>>(), log.tables)
        });
        for many in [two, four] {
            assert_eq!((&one.0, &one.1), (&many.0, &many.1), "{seed}");
            assert!(one.2 == many.2, "{seed}");
        }
    }
}

#[test]
fn the_readers_own_columns_do_not_depend_on_what_else_is_wanted() {
    let row = |n: usize| format!("{n};2026;{};0000008{};0;0;0;{};8.5;400\n", n % 8, 3 + n % 5, n % 2 * 47);
    let xsens = "SampleTimeFine;UTC_Year;UTC_Valid;StatusWord;Vel_E;Vel_N;Vel_U;Latitude;Longitude;Altitude\n";
    let oxts = |n: usize| format!("{n},47.0,8.5,{}.000\n", n % 12);
    for (text, own) in [
        (xsens.to_owned() + &(0..40).map(row).collect::<String>(), &["fix_ok", "utc_year", "velocity_given"][..]),
        ("t,PosLat,PosLon,GpsPosMode\n".to_owned() + &(0..40).map(oxts).collect::<String>(), &["fix_ok"]),
    ] {
        let all = read(&text);
        let number = |path: &&str| FieldRequest { path: (*path).to_owned(), kind: ValueKind::Number };
        let fields = Selection::Fields(own.iter().map(number).collect());
        let alone = read_limited(text.as_bytes(), &fields, Limits::default()).unwrap();
        assert_eq!(alone.tables[0].columns.len(), own.len());
        for path in own {
            let column = all.tables[0].column(path).unwrap();
            assert_eq!(Some(column), alone.tables[0].column(path), "{path}");
            let values: Vec<f64> = (0..40).filter_map(|row| column.number(row)).collect();
            assert!(values.iter().any(|value| *value != values[0]) || *path != "fix_ok", "{path}: {values:?}");
        }
        assert_eq!(all.notices.iter().filter(|n| n.code == "unknown-word").count(), 0);
    }
}

#[test]
fn the_detected_layout_is_stated() {
    let format = |text| read(text).health.format;
    assert_eq!(format("t,x\n1,2\n"), "CSV, ',' delimited, header in line 1");
    assert_eq!(format("# a\n#s,m\n t; x \n(s);(m)\n1;2\n"), "CSV, ';' delimited, header in line 3, units in line 4");
    assert_eq!(format("#info, a=1\n#s, m\n  t, x\n1, 2\n"), "CSV, ',' delimited, header in line 3, units in line 2");
    assert_eq!(format("1\t2\n3\t4\n"), "CSV, TAB delimited, no header");
}

#[test]
fn a_decimal_comma_is_read_where_it_is_certain_and_the_layout_says_so() {
    for text in ["t;x\n1;0,5\n2;-1,5e-3\n", "t\tx\n1\t0,5\n2\t-1,5E-03\n", "t;x;\n1,0;0,5;\n2,0;-0,0015;\n"] {
        assert_plain(text, text);
        assert!(read(text).health.format.contains("decimal comma"), "{}", read(text).health.format);
    }
    // Quoted in a table with commas between, it may be a list: it stays text.
    let log = read("t,x\n1,\"0,5\"\n2,\"1,5\"\n");
    assert_eq!(log.tables[0].column("x").unwrap().text(0), Some("0,5"));
    // Times with a decimal comma are the same.
    let log = read("date;time;x\n23.06.2021;17:27:44,3;0,5\n23.06.2021;17:27:44,4;0,5\n");
    assert_eq!(log.tables[0].column("time").unwrap().text(0), Some("17:27:44.3"));
}

/// Rejected cells of `x`: the notice names line and column.
fn assert_refused(text: &str, cell: &str, lines: &str) {
    let fields = vec![FieldRequest { path: "x".into(), kind: ValueKind::Number }];
    let log = read_limited(text.as_bytes(), &Selection::Fields(fields), Limits::default()).unwrap();
    let notice = log.notices.iter().find(|n| n.code == "rejected-cell").unwrap_or_else(|| panic!("{text}"));
    assert!(notice.text.contains("column x") && notice.text.contains(cell), "{}", notice.text);
    let word = if lines.contains(',') { "lines" } else { "line" };
    assert!(notice.text.ends_with(&format!("; {word} {lines}")), "{}", notice.text);
}

#[test]
fn thousands_separators_are_rejected_with_line_and_column() {
    // Whether these are decimals is ambiguous.
    assert_refused("t;x\n1;1,250\n2;12,500\n", "\"1,250\"", "2, 3");
    // Next to decimals they are not decimals.
    assert_refused("t;x\n1;1,250.5\n2;7.5\n", "\"1,250.5\"", "2");
    assert_refused("t;x\n1;1.250,5\n2;7,5\n", "\"1.250,5\"", "2");
    assert_refused("t,x\n1,\"1,250\"\n2,7.5\n", "\"1,250\"", "2");
    // A point in a table with decimal commas may be a thousands separator.
    assert_refused("t;x\n1;0,5\n2;7.500\n", "\"7.500\"", "3");
    assert_refused("t,x\n1,1 250\n2,0x1f\n3,5\n", "\"1 250\"", "2, 3");
    // A whole column of them is a loss; a column of words is not, as it was not meant as numbers.
    let lost = |text: &str| {
        let fields = vec![FieldRequest { path: "x".into(), kind: ValueKind::Number }];
        read_limited(text.as_bytes(), &Selection::Fields(fields), Limits::default()).unwrap().notices.any_loss()
    };
    assert!(lost("t,x\n1,\"1,250.5\"\n2,\"-1,251.5\"\n") && lost("t;x\n1;1,250\n2;12,500\n"));
    assert!(!lost("t,x\n1,idle\n2,\"on, off\"\n"));
}

#[test]
fn nineteen_digit_timestamps_stay_exact_and_small_integers_are_numbers() {
    let log = read("stamp,count,mixed\n1531943812200143162,1,7\n1531943812200143163,2,7.5\n");
    let table = &log.tables[0];
    let of = |path: &str| &table.column(path).unwrap().data;
    assert_eq!(of("stamp"), &ColumnData::I64(vec![1_531_943_812_200_143_162, 1_531_943_812_200_143_163]));
    assert_eq!(of("count"), &ColumnData::F64(vec![1.0, 2.0]));
    assert_eq!(of("mixed"), &ColumnData::F64(vec![7.0, 7.5]));
}

#[test]
fn empty_and_non_finite_cells_are_missing_and_counted() {
    let log = read("t,x\n1,\n2,nan\n3,-inf\n4,1e999\n5,6\n");
    assert_eq!(numbers(&log, "x"), [None, None, None, None, Some(6.0)]);
}

#[test]
fn a_column_wanted_as_a_number_reports_cells_that_are_not() {
    let fields = vec![FieldRequest { path: "x".into(), kind: ValueKind::Number }];
    let text = b"t,x\n1,a\n2,2\n3,b\n4,nan\n5,N/A\n";
    let log = read_limited(text, &Selection::Fields(fields), Limits::default()).unwrap();
    assert_eq!(numbers(&log, "x"), [None, Some(2.0), None, None, None]);
    let reported = log.notices.iter().filter(|n| n.code == "rejected-cell").map(|n| (n.severity, n.count));
    assert_eq!(reported.collect::<Vec<_>>(), [(Severity::Loss, 2), (Severity::Info, 2)]);
}

#[test]
fn more_than_one_bad_cell_in_a_hundred_is_a_loss() {
    for (rows, severity) in [(100, Severity::Warning), (99, Severity::Loss)] {
        let cells: String = (0..rows).map(|i| format!("{i},{}\n", if i == 50 { "x" } else { "1.5" })).collect();
        let field = FieldRequest { path: "v".to_owned(), kind: ValueKind::Number };
        let text = format!("t,v\n{cells}");
        let log = read_limited(text.as_bytes(), &Selection::Fields(vec![field]), Limits::default()).unwrap();
        let notice = log.notices.iter().find(|n| n.code == "rejected-cell").unwrap();
        assert_eq!((notice.severity, notice.count), (severity, 1));
    }
}

#[test]
fn a_path_wanted_as_number_and_text_is_text_if_it_holds_no_number() {
    let both = |path: &str| [ValueKind::Number, ValueKind::Text].map(|kind| FieldRequest { path: path.into(), kind });
    let selection = Selection::Fields([both("time"), both("n")].concat());
    let log = read_limited(b"time,n\n2024-05-10T17:27:44Z,0.10\n", &selection, Limits::default()).unwrap();
    let table = &log.tables[0];
    assert_eq!(table.columns.iter().filter(|c| c.path == "time").count(), 1);
    assert_eq!(table.column("time").unwrap().text(0), Some("2024-05-10T17:27:44Z"));
    assert_eq!(table.column("n").unwrap().number(0), Some(0.1));
    assert_eq!(table.columns.last().map(|c| c.path.as_str()), Some("time"));
    assert_eq!(table.columns.iter().filter_map(|c| c.text(0)).collect::<Vec<_>>(), ["0.10", "2024-05-10T17:27:44Z"]);
    assert!(log.notices.is_empty(), "{:?}", log.notices);
}

#[test]
fn ragged_rows_are_rejected_with_their_line_and_bytes() {
    let log = read("t,x\n1,2\n3\n4,5,6\n7,8\n");
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(7.0)]);
    assert_eq!(log.tables[0].origin, ingest::Places::from_iter([2, 5]));
    let damage: Vec<_> = log.health.damage.iter().map(|d| (d.offset, d.length, d.reason.as_str())).collect();
    assert_eq!(
        damage,
        [(8, 2, "line 3: 1 field, but the header has 2"), (10, 6, "line 4: 3 fields, but the header has 2")]
    );
    assert!(log.notices.any_loss());
}

#[test]
fn a_truncated_last_row_is_distinguished_from_a_missing_line_end() {
    let cut = read("t,x\n1,2\n3,4\n5");
    assert_eq!(
        cut.health.damage[0].reason,
        "line 4: 1 field, but the header has 2, and no line end: the log is truncated here"
    );
    // Only digits after the last delimiter may be missing.
    let open = read("t,x\n1,2\n3,45");
    assert_eq!(numbers(&open, "t"), [Some(1.0), Some(3.0)]);
    assert_eq!(numbers(&open, "x"), [Some(2.0), None]);
    assert!(!open.notices.any_loss() && open.notices.iter().any(|n| n.code == "rejected-cell"));
}

#[test]
fn zero_bytes_cost_their_row_and_a_long_run_of_them_ends_the_table() {
    let log = read("t,x\n1,2\n3,\0\0\n5,6\n");
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(5.0)]);
    assert_eq!(log.health.damage[0].reason, "line 3: zero bytes in the row");
    let mut text = b"t,x\n1,2\n".to_vec();
    text.resize(200_000, 0);
    let limits = Limits { line_bytes: 10_000, ..Limits::default() };
    let log = read_limited(&text, &Selection::All, limits).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (1, 200_000 - 8));
}

#[test]
fn a_line_over_the_limit_is_skipped_and_counted() {
    let text = format!("t,x\n1,2\n3,{}\n5,6\n", "9".repeat(20_000));
    let limits = Limits { line_bytes: 1000, ..Limits::default() };
    let log = read_limited(text.as_bytes(), &Selection::All, limits).unwrap();
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(5.0)]);
    assert_eq!((log.health.undecodable, log.health.bytes.damaged), (1, 20_003));
}

#[test]
fn a_stray_quote_costs_only_its_row() {
    let log = read("t,x,note\n1,2,a\n3,4,\"b\n5,6,c\n7,8,\"d\n9,10,e\n");
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(5.0), Some(9.0)]);
    let log = read("t,x\n1,\"2\n3,4\n5,6\n");
    assert_eq!(numbers(&log, "t"), [Some(3.0), Some(5.0)]);
}

#[test]
fn repeated_and_empty_names_become_unique_with_a_notice() {
    let log = read("t,x,x,,t\n1,2,3,4,5\n");
    let mut names: Vec<&str> = log.tables[0].columns.iter().map(|c| c.path.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["column_4", "t", "t#5", "x", "x#3"]);
    assert_eq!(log.notices.iter().find(|n| n.code == "column-renamed").unwrap().count, 3);
}

#[test]
fn formula_escapes_in_names_and_texts_are_undone() {
    let texts = ["=SUM(A1:A9)", "-5", "'quoted'", "@home", "plain"];
    let rows: String = texts.iter().map(|text| format!("1.5,{}\n", ingest::inert(text))).collect();
    let log = read(&format!("t,{}\n{rows}", ingest::inert("=n")));
    let column = log.tables[0].column("=n").unwrap();
    assert_eq!(texts.map(Some), [0, 1, 2, 3, 4].map(|row| column.text(row)).each_ref().map(Option::as_deref));
}

#[test]
fn a_file_that_is_not_a_table_is_rejected_with_a_reason() {
    for (text, reason) in [
        (&b""[..], "empty"),
        (b"\xff\xfet\0,\0x\0", "UTF-16"),
        (b"one\ntwo\nthree\n", "not a table"),
        (b"t,x", "not a table"),
    ] {
        let error = read_limited(text, &Selection::All, Limits::default()).unwrap_err().to_string();
        assert!(error.starts_with("t.csv: ") && error.contains(reason), "{error}");
    }
}

#[test]
fn invalid_utf8_costs_only_its_cell_and_is_latin_1_in_a_name() {
    let log = read_limited(b"t,x\xe9\n1,2\n\xff,3\n", &Selection::All, Limits::default()).unwrap();
    assert_eq!(numbers(&log, "x\u{e9}"), [Some(2.0), Some(3.0)]);
}

#[test]
fn an_unwanted_table_is_counted_but_not_parsed() {
    let log = read_limited(b"t,x\n1,2\n3\n4,5\n", &Selection::Skip, Limits::default()).unwrap();
    assert!(log.tables.is_empty());
    assert_eq!((log.health.messages, log.health.bytes.skipped, log.health.bytes.structure), (3, 10, 4));
}

#[test]
fn flysight_2_rows_go_to_the_tables_they_name() {
    let text = "$FLYS,1\n$VAR,FIRMWARE_VER,v1\n$COL,GNSS,time,lat\n$UNIT,GNSS,,deg\n$COL,IMU,time,wx\n$DATA\n\
                $GNSS,2024-04-20T04:20:00.000Z,33.5\n$IMU,1.5,0.25\n$IMU,2.5\n$XYZ,1\n$IMU,3.5,0.5\n";
    let log = read(text);
    let names: Vec<(&str, usize)> = log.tables.iter().map(|t| (t.topic.name.as_str(), t.rows)).collect();
    assert_eq!(names, [("GNSS", 1), ("IMU", 2)]);
    assert_eq!(log.tables[1].column("wx").unwrap().data, ColumnData::F64(vec![0.25, 0.5]));
    assert_eq!(log.health.extras, ["FIRMWARE_VER = v1"]);
    let reasons: Vec<&str> = log.health.damage.iter().map(|d| d.reason.as_str()).collect();
    assert_eq!(reasons, ["line 9: 1 field, but the header has 2", "line 10: no $COL line announces this row"]);
}

#[test]
fn a_flysight_2_file_with_endless_table_declarations_is_read_in_time() {
    let text: String = (0..60_000).map(|i| format!("$COL,T{},a{i}\n$VAR,k,{i}\n", i % 30_000)).collect();
    let log = read_limited(format!("$FLYS,1\n{text}").as_bytes(), &Selection::Skip, Limits::default()).unwrap();
    assert_eq!((log.health.topics.len(), log.health.extras.len()), (60_000, 256));
}

#[test]
fn a_table_declared_again_continues_unless_its_columns_differ() {
    let log = read("$FLYS,1\n$COL,GNSS,t,x\n$GNSS,1,2\n$COL,GNSS,t,x\n$GNSS,3,4\n$COL,GNSS,t,y\n$GNSS,5,6\n");
    let names: Vec<(&str, usize)> = log.tables.iter().map(|t| (t.topic.name.as_str(), t.rows)).collect();
    assert_eq!(names, [("GNSS", 2), ("GNSS from line 6", 1)]);
    let endless = format!("$FLYS,1\n{}", "$COL,GNSS,t,x\n$COL,GNSS,t,y\n".repeat(50_000));
    let log = read_limited(endless.as_bytes(), &Selection::Skip, Limits::default()).unwrap();
    assert_eq!(log.health.topics.len(), Limits::default().topics);
}

#[test]
fn a_header_of_a_hundred_thousand_equal_names_is_read_in_time() {
    let (header, row) = ("x,".repeat(100_000), "1,".repeat(100_000));
    let log = read_limited(format!("{header}\n{row}\n").as_bytes(), &Selection::All, Limits::default()).unwrap();
    assert_eq!((log.tables[0].columns.len(), log.health.messages), (100_000, 1));
}

#[test]
fn rostopic_echo_names_lose_their_field_prefix_and_keep_the_time() {
    let log = read("%time,field.header.stamp,field.data\n10,1531943812200143162,1.5\n");
    assert_eq!(log.tables[0].column("header.stamp").unwrap().integer(0), Some(1_531_943_812_200_143_162));
    assert_eq!(numbers(&log, "%time"), [Some(10.0)]);
}

#[test]
fn several_files_are_topics_of_one_log_and_a_stray_one_is_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let files =
        vec![write("f-b.csv", "t,x\n1,2\n"), write("f-a.csv", "t,x\n1,2\n3,4\n"), write("f-note.csv", "hello\n")];
    let want = |_: &TopicInfo| Selection::All;
    let log = read_files(Limits::default(), ingest::LogKind::Csv, &files, &want).unwrap();
    let topics: Vec<(&str, u64)> = log.health.topics.iter().map(|t| (t.name.as_str(), t.messages)).collect();
    assert_eq!(topics, [("f-a", 2), ("f-b", 1)]);
    assert_eq!((log.health.bytes.size, log.health.bytes.skipped), (26, 6));
    assert!(log.notices.iter().any(|n| n.code == "no-rows" && n.place == "f-note.csv"));
}

#[test]
fn the_payload_of_a_table_is_its_rows_without_their_line_ends() {
    for (text, payload) in [
        ("t,x\n1,2\n30,40\n", "1,230,40"),
        ("t,x\r\n1,2\r\n30,40\r\n", "1,230,40"),
        ("t,x\n1,2\n\n# remark\n30,40\n", "1,230,40"),
        ("t,x\n1,\"a\nb\"\n2,c\n", "1,\"a\nb\"2,c"),
    ] {
        for selection in [Selection::All, Selection::Skip] {
            let log = read_limited(text.as_bytes(), &selection, Limits::default()).unwrap();
            let [topic] = log.health.topics.as_slice() else { panic!("{:?}", log.health.topics) };
            assert_eq!((topic.messages, topic.payload_bytes), (2, payload.len() as u64), "{text:?} {selection:?}");
        }
    }
}

#[test]
fn every_truncation_gives_a_prefix_or_a_reason_and_counts_every_byte() {
    let texts = [
        "# c\nt,x,n\ns,m,\n1,0.5,\"a,b\"\n2,1.5,\"c\nd\"\n3,2.5,e\n",
        "\u{feff}t;x\r\n1;2.25\r\n3;4.75\r\n5;6.125\r\n",
        "$FLYS,1\n$COL,GNSS,t,x\n$DATA\n$GNSS,1,2.25\n$GNSS,3,4.75\n",
    ];
    for text in texts {
        let whole = read(text);
        let rows = |log: &Log, path: &str| {
            let table = log.tables.iter().find(|t| t.column(path).is_some())?;
            Some((0..table.rows).map(|r| table.column(path)?.number(r)).collect::<Vec<_>>())
        };
        let (t, x) = (rows(&whole, "t").unwrap(), rows(&whole, "x").unwrap());
        for end in 0..text.len() {
            let Ok(log) = read_limited(&text.as_bytes()[..end], &Selection::All, Limits::default()) else { continue };
            // A truncated header has other names, but then there are no rows.
            for (path, truth) in [("t", &t), ("x", &x)] {
                let got = rows(&log, path).unwrap_or_default();
                for (row, value) in got.iter().enumerate() {
                    assert!(value.is_none() || *value == truth[row], "{end}: {path} of row {row} is {value:?}");
                }
            }
            let cut_inside =
                !text.as_bytes()[..end].ends_with(b"\n") && log.health.messages + log.health.undecodable > 0;
            let flagged = !log.notices.is_empty() || log.health.bytes.damaged > 0;
            assert!(flagged || !cut_inside || text.as_bytes()[end - 1] == b'\r', "{end}: an unreported cut");
        }
    }
}

#[test]
fn every_single_bit_flip_is_read_or_rejected_without_a_panic() {
    let text = b"# c\nt,x,n\n1,0.5,\"a,b\"\n2,1.5,c\n3,2.5,e\n";
    for byte in 0..text.len() {
        for bit in 0..8 {
            let mut flipped = text.to_vec();
            flipped[byte] ^= 1 << bit;
            // The sum of the ledger is asserted inside.
            let _ = read_limited(&flipped, &Selection::All, Limits::default());
        }
    }
}

#[test]
fn a_real_garmin_file_that_ends_inside_a_row_loses_only_that_row() {
    let Some(loaded) = load_real("flightlogstats-G1000/flightlogstatsTests/TestAssets/log_220417_125002_LFQA.csv")
    else {
        return;
    };
    // wc -l and awk: 2844 lines, 3 of them before the rows; the 2845th has 5 of 80 fields.
    assert_eq!((loaded.health.messages, loaded.health.undecodable), (2841, 0));
    // 47 of 1.9 million bytes: where the power was lost.
    assert_eq!((loaded.health.bytes.tail_cut, loaded.health.bytes.damaged), (47, 0));
    assert!(!lossy(&loaded));
}

#[test]
fn a_repeated_header_between_the_rows_is_not_a_row() {
    let log = read("t,x\n1,2\nt,x\n3,4\n\nt,x\n5,6\n");
    assert_eq!(numbers(&log, "t"), [Some(1.0), Some(3.0), Some(5.0)]);
    let notice = log.notices.iter().find(|n| n.code == "irregular-table").unwrap();
    assert_eq!((notice.count, log.health.messages), (2, 3));
}

#[test]
fn lines_after_two_slashes_are_comments_and_blanks_are_a_delimiter() {
    assert_plain("// Start Time: Unknown\n// Update Rate: 100.0Hz, \"x\nt\tx\n1\t0.5\n2\t-1.5e-3\n", "slashes");
    assert_plain("t x\n  1   0.5\n  2  -1.5e-3\n", "blanks");
    let log = read("   1.0e+00   5.0e-01\r\n   2.0e+00  -1.5e-03\r\n 3 4\r\n 5 6\r\n");
    assert_eq!(numbers(&log, "column_2"), [Some(0.5), Some(-1.5e-3), Some(4.0), Some(6.0)]);
    assert_eq!(log.health.format, "CSV, blank delimited, no header");
}

#[test]
fn rows_that_name_their_table_go_to_it_and_keep_its_width() {
    let whole = "10,imu,1,2,3\n12,baro,487.5\n14,imu,4,5,6\n16,baro,487.6\n".repeat(2);
    let log = read(&format!("{whole}18,imu,7,8\n20,baro,48"));
    let table = |name: &str| log.tables.iter().find(|t| t.topic.name == name).unwrap();
    assert_eq!((table("imu").rows, table("baro").rows), (4, 5));
    assert_eq!(table("imu").column("column_5").unwrap().number(1), Some(6.0));
    // The row truncated at the end lost its value, and the short one is reported.
    assert_eq!(table("baro").column("column_3").unwrap().number(4), None);
    assert_eq!(log.health.damage[0].reason, "line 9: 4 fields, but the header has 5");
}

const NOVATEL: &str = "#INSPVAA,COM1,0,31.0,FINESTEERING,1264,144088.000,00040000,5615,1541;1264,144088.002284950,51.116827527,-114.037738908,401.191547167,354.846489850,108.429407241,-10.837482850,1.116219952,-3.476059035,7.372686190,INS_ALIGNMENT_COMPLETE*af719fd9\r\n";

#[test]
fn novatel_messages_become_tables_and_a_wrong_checksum_costs_its_line() {
    let log = read(&format!("{NOVATEL}<OK\r\n{}{NOVATEL}", NOVATEL.replace("51.116", "52.116")));
    assert_eq!(log.tables[0].topic.name, "INSPVA");
    assert_eq!(numbers(&log, "lat"), [Some(51.116_827_527), Some(51.116_827_527)]);
    assert_eq!(numbers(&log, "header.seconds"), [Some(144_088.0), Some(144_088.0)]);
    assert_eq!(log.health.damage[0].reason, "line 3: the CRC-32 is wrong");
    assert_eq!((log.health.messages, log.health.undecodable), (2, 1));
}

#[test]
fn words_for_missing_values_are_missing_numbers_and_not_a_loss() {
    // Missing values as written by pandas, databases, spreadsheets and the C library of Windows.
    let words = ["N/A", "NA", "null", "NULL", "None", "--", "-", "#N/A", "-nan(ind)", "1.#QNAN"];
    let rows: String = words.iter().map(|word| format!("1,{word}\n2,7.5\n")).collect();
    for selection in
        [Selection::All, Selection::Fields(vec![FieldRequest { path: "x".into(), kind: ValueKind::Number }])]
    {
        let log = read_limited(format!("t,x\n{rows}").as_bytes(), &selection, Limits::default()).unwrap();
        assert_eq!(numbers(&log, "x"), [None, Some(7.5)].repeat(words.len()));
        assert!(!log.notices.any_loss(), "{:?}", log.notices);
    }
    // A lone minus or point, a unit after a number, and hexadecimal digits are not understood.
    for bad in ["+", ".", "5%", "0x1f", "n", "nothing"] {
        assert_refused(&format!("t,x\n1,{bad}\n2,7.5\n"), bad, "2");
    }
}

#[test]
fn words_for_missing_values_among_words_or_alone_stay_words() {
    let texts = |text: &str| {
        let log = read(text);
        let column = log.tables[0].column("x").unwrap().clone();
        (0..log.tables[0].rows).map(|row| column.text(row).map(|text| text.to_string())).collect::<Vec<_>>()
    };
    let some = |texts: &[&str]| texts.iter().map(|text| Some((*text).to_owned())).collect::<Vec<_>>();
    assert_eq!(texts("t,x\n1,None\n2,Hold\n3,None\n"), some(&["None", "Hold", "None"]));
    assert_eq!(texts("t,x\n1,None\n2,None\n"), some(&["None", "None"]));
    assert_eq!(texts("t,x\n1,None\n2,\n3,Hold\n"), [some(&["None"]), vec![None], some(&["Hold"])].concat());
    assert_eq!(texts("t,x\n1,7\n2,nan\n3,Hold\n"), some(&["7", "nan", "Hold"]));
}

#[test]
fn rows_below_another_header_are_a_loss_up_to_the_first_header_again() {
    // Concatenated logs, or a reconfigured logger: another order; an extra first column, so another width;
    // one less; quotes.
    for below in [
        "x,t\n30,3\n40,4\n",
        "x;t\n30;3\n40;4\n",
        "new,t,x\n7,3,30\n8,4,40\n",
        "\"x\",\"t\"\n30,3\n40,4\n",
        "t,y,z\n3,0,0\n4,0,0\n",
    ] {
        let delimiter = if below.contains(';') { ";" } else { "," };
        let head = "t,y,x\n1,0,10\n2,0,20\n".replace(',', delimiter);
        let again = "t,y,x\n5,0,50\n".replace(',', delimiter);
        let log = read(&[head.as_str(), below, &again].concat());
        assert_eq!(numbers(&log, "t"), [1.0, 2.0, 5.0].map(Some), "{below}");
        assert_eq!(numbers(&log, "x"), [10.0, 20.0, 50.0].map(Some), "{below}");
        assert_eq!((log.health.bytes.damaged, log.health.messages), (below.len() as u64, 3), "{below}");
        let reported =
            log.notices.iter().find(|n| n.code == "irregular-table" && n.severity == Severity::Loss).unwrap();
        assert_eq!((reported.count, reported.place.as_str()), (1, "t.csv, line 4"), "{below}");
    }
    // The same header in quotes.
    let log = read("t,x\n1,10\n\"t\",\"x\"\n2,20\n");
    assert_eq!((numbers(&log, "t"), log.notices.any_loss()), (vec![Some(1.0), Some(2.0)], false));
    // Words in rows are not a header.
    let log = read("t,mode,x\n1,auto,x\n2,x,auto\n3,t,7\n");
    assert_eq!(log.health.messages, 3);
}

#[test]
fn rows_of_another_table_before_the_header_are_a_loss_but_remarks_are_not() {
    let rows = |columns: usize, rows: usize| format!("1{}\n", ",2".repeat(columns - 1)).repeat(rows);
    let log = read(&format!("t,x,y\n{}t,x,y,z\n{}", rows(3, 6), rows(4, 20)));
    assert_eq!(log.health.messages, 20);
    let loss = log.notices.iter().find(|n| n.code == "irregular-table").unwrap();
    assert_eq!((loss.severity, loss.count), (Severity::Loss, 6));
    assert!(loss.text.contains("from line 2 on"), "{}", loss.text);
    let remarks = "Logger,3.0\nSerial,77\nRate,10\nRange,4\nGain,1,2,a,b\n";
    let log = read(&format!("{remarks}t,x,y,z\n{}", rows(4, 20)));
    assert!(!log.notices.any_loss() && log.health.messages == 20, "{:?}", log.notices);
}

#[test]
fn a_first_row_that_is_not_a_description_stays_a_row() {
    for text in [
        "t,event\n1,start\n2,stop\n",
        "date,event\n2024-05-06,N/A\n2024-05-07,3\n",
        "what,how\nstart,fast\nstop,slow\n",
    ] {
        assert_eq!(read(text).health.messages, 2, "{text}: {}", read(text).health.format);
    }
}

#[test]
fn a_table_with_binary_bytes_between_rows_is_a_table_under_any_name() {
    let rows: String = (0..100).map(|i| format!("{i},47.4,8.5\n")).collect();
    let text = [b"time,lat,lon\n", rows.as_bytes()].concat();
    let garbage = b"\xfe\x09\x00\x01\x01\x00\x00\x00\x00\x00\x02\x03\x51\x04\x03\n";
    let kinds = |content: &[u8]| {
        let (_folder, path) = file("table.dat", content);
        let found = ingest::discover(&path, &ingest::MapLibrary::shipped().unwrap()).unwrap();
        let reason = found.ignored.first().map(|(_, reason)| reason.clone()).unwrap_or_default();
        (found.units.iter().map(|unit| unit.kind).collect::<Vec<_>>(), reason)
    };
    let damaged = [&text[..], garbage, rows.as_bytes()].concat();
    assert_eq!(kinds(&damaged).0, [ingest::LogKind::Csv]);
    let log = read_limited(&damaged, &Selection::All, Limits::default()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (200, garbage.len() as u64));
    // Some lines before binary numbers prove nothing, nor does text that is not a table.
    for head in ["BEGIN 1.0\nname,size\nx,3\n".to_owned(), "A line of text.\n".repeat(20)] {
        let (kinds, reason) = kinds(&[head.as_bytes(), garbage].concat());
        assert_eq!((kinds.len(), reason.as_str()), (0, "binary file of an unknown format"), "{head}");
    }
}

#[test]
fn endless_other_headers_are_skipped_in_time_and_reported_once() {
    let names: Vec<String> = (0..30_000).map(|i| format!("c{i}")).collect();
    let back: Vec<String> = names.iter().rev().cloned().collect();
    let text = format!("{}\n{}", names.join(","), [back.join(","), names.join(",")].join("\n").repeat(3)) + "\n";
    let log = read_limited(text.as_bytes(), &Selection::Skip, Limits::default()).unwrap();
    assert_eq!(log.health.messages, 0);
    // All of the same name, with more of it further down.
    let text = format!("a,b{}\n{}\n", ",a".repeat(30_000), ["b", &",a".repeat(60_000)].concat());
    let log = read_limited(text.as_bytes(), &Selection::Skip, Limits::default()).unwrap();
    assert_eq!(log.health.messages, 0);
    let few = format!("t,x\n{}", "x,t\n1,2\nt,x\n2,1\n".repeat(1000));
    let log = read(&few);
    assert_eq!((numbers(&log, "t"), log.health.undecodable), (vec![Some(2.0); 1000], 2000));
    let reported: Vec<u64> = log.notices.iter().filter(|n| n.code == "irregular-table").map(|n| n.count).collect();
    assert_eq!(reported, [1000, 1000], "others, and repeated");
}

/// Rows of a table with a cell for each of `cells`, by row.
fn rows(count: usize, delimiter: &str, cells: &[&dyn Fn(usize) -> String]) -> String {
    let row = |i: usize| cells.iter().map(|cell| cell(i)).collect::<Vec<_>>().join(delimiter) + "\n";
    (0..count).map(row).collect()
}

#[test]
fn another_header_is_distinguished_from_rows_in_any_style() {
    let (t, x, index) =
        (&|i: usize| i.to_string(), &|i: usize| (100 + i).to_string(), &|i: usize| (7000 + i).to_string());
    for (delimiter, first, second, names) in [
        ("\t", "\tt\tx", "\tx\tt", ["column_1", "t", "x"]),
        (",", ",t,x", ",x,t", ["column_1", "t", "x"]),
        (";", "t;;x", "t;x;", ["column_2", "t", "x"]),
        (",", ",t,x,", ",x,t,", ["column_1", "t", "x"]),
        (",", "# i,t,x", "# i,x,t", ["i", "t", "x"]),
        (",", "# i,t,x", "# \"i\",\"x\",\"t\"", ["i", "t", "x"]),
        ("\t", "\tt\tx", "t\tx\t", ["column_1", "t", "x"]),
        (",", ".i,.t,.x", ".x,.t,.i", [".i", ".t", ".x"]),
        (",", "\"i, s\",t,\"x, m\"", "\"x, m\",t,\"i, s\"", ["i, s", "t", "x, m"]),
        (",", "\u{feff}i,t,x", "\u{feff}i,t,x", ["i", "t", "x"]),
        (",", "i,t,x\ns,s,m", "i,t,x\ns,s,m", ["i", "t", "x"]),
    ] {
        let cell_of = |header: &str| -> Vec<&dyn Fn(usize) -> String> {
            let names = header.lines().next().unwrap().trim_start_matches(['#', ' ', '\u{feff}']).replace(", ", "");
            let cell = |name: &str| -> &dyn Fn(usize) -> String {
                match name.trim_start_matches(['.', '"']).chars().next() {
                    Some('t') => t,
                    Some('x') => x,
                    _ => index,
                }
            };
            names.split(delimiter).map(cell).collect()
        };
        let parts = [first, second].map(|header| rows(60, delimiter, &cell_of(header)));
        let more = rows(100, delimiter, &cell_of(first));
        // Whole blocks of rows, and rows one by one.
        for end in ["", "# \"end\"\n"] {
            let log = read(&format!("{first}\n{more}{second}\n{}{end}", parts[1]));
            let more = if first == second { 60 } else { 0 };
            for (name, base) in names.iter().zip([7000, 0, 100]) {
                let expected = (0..100).chain(0..more).map(|i| Some((base + i) as f64)).collect::<Vec<_>>();
                assert_eq!(numbers(&log, name), expected, "{first:?} {name} {:#?}", log.notices);
            }
            let lost = if first == second { 0 } else { 61 };
            assert_eq!((log.health.undecodable, log.tables[0].rows), (lost, 100 + more), "{first:?}");
        }
    }
}

#[test]
fn units_far_after_a_repeated_header_are_a_row_for_any_block_size() {
    let block = |from: usize| (from..from + 50_000).map(|i| format!("{i},{}.5,{i}\n", 2 * i)).collect::<String>();
    for rows in [3, 100_000] {
        let few = |from: usize| block(from).lines().take(rows).map(|line| format!("{line}\n")).collect::<String>();
        let text = format!("t,a,b\ns,m,m\n{}t,a,b\n{}s,m,m\n{}", few(0), few(50_000), few(100_000));
        let log = read(&text);
        let expected = 3 * rows.min(50_000) + 1;
        assert_eq!(log.tables[0].rows, expected, "{:?}", log.notices);
        let paths = ["t", "a"].map(|path| FieldRequest { path: path.into(), kind: ValueKind::Number });
        let some = read_limited(text.as_bytes(), &Selection::Fields(paths.into()), Limits::default()).unwrap();
        assert_eq!(some.tables[0].rows, expected, "{:?}", some.notices);
    }
}

#[test]
fn damage_in_an_unwanted_table_is_found_if_nothing_may_be_skipped() {
    let text = "t,x\n1,2\n3\n4,5\n\"6,7\n8,9,10\n11,12\n";
    let read = |may_leave_closed| {
        let limits = Limits { may_leave_closed, ..Limits::default() };
        read_limited(text.as_bytes(), &Selection::Skip, limits).unwrap().health
    };
    assert_eq!((read(true).bytes.damaged, read(true).messages), (0, 6));
    let whole = read(false);
    assert_eq!((whole.damage_count, whole.messages), (3, 3), "{:?}", whole.damage);
}

#[test]
fn remarks_are_not_rows_and_those_that_look_like_rows_are_reported() {
    let row = |i: usize| format!("{}{i},{i},{}.5\n", if i.is_multiple_of(3) { '#' } else { 'A' }, 2 * i);
    let log = read(&format!("tag,t,b\n{}", (0..300).map(row).collect::<String>()));
    let reported = log.notices.iter().find(|n| n.code == "irregular-table").unwrap();
    assert_eq!((log.tables[0].rows, reported.count, numbers(&log, "t")[0]), (200, 100, Some(1.0)), "{:?}", log.notices);
    // A commented-out row of numbers.
    let log = read("t,b\n1,2\n#3,4\n# a remark, of words\n5,6\n");
    assert_eq!(log.tables[0].rows, 2);
    assert!(log.notices.iter().any(|n| n.code == "irregular-table" && n.count == 1), "{:?}", log.notices);
    // Remarks of a spreadsheet, and commented-out rows of a table that begins with words.
    for remark in ["# second part,,", "#second part,,", "# total,1,2", "#2024-01-01 12:00:20,777,9", "// note,1,2"] {
        let log = read(&format!("name,x,y\na,1,2\nb,3,4\n{remark}\nc,5,6\n"));
        assert_eq!(log.tables[0].rows, 3, "{remark}");
    }
}

#[test]
fn a_table_after_another_with_as_many_columns_is_reported() {
    let rows = "1,2,3\n4,5,6\n".repeat(20);
    let log = read(&format!("t,a,b\n{rows}\nx,y,z\n{rows}"));
    let reported = log.notices.iter().find(|n| n.code == "irregular-table").unwrap();
    assert_eq!((reported.severity, reported.count, reported.place.as_str()), (Severity::Warning, 1, "t.csv, line 43"));
}

#[test]
fn a_labview_measurement_file_is_the_table_after_its_preambles() {
    let preamble = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDate\t2024/05/10\n***End_of_Header***\t\n\t\n\
                    Channels\t2\t\t\nSamples\t100\t100\t\nX0\t0.0\t0.0\t\n***End_of_Header***\t\t\t\n";
    for end in ["", "\t"] {
        let rows: String = (0..100).map(|i| format!("{i}.5\t{}\t20.0{end}\n", 2 * i)).collect();
        let log = read(&format!("{preamble}X_Value\tVoltage\tTemp\tComment\n{rows}"));
        assert_eq!((log.tables[0].rows, log.health.bytes.damaged), (100, 0), "{:?}", log.notices);
        assert_eq!((numbers(&log, "X_Value")[3], numbers(&log, "Voltage")[3]), (Some(3.5), Some(6.0)));
    }
}

#[test]
fn rows_of_another_table_of_equal_width_are_not_mixed_with_the_first() {
    let number: &dyn Fn(usize) -> String = &|i: usize| (100 + i).to_string();
    let text = |first: &str, second: &str| {
        let width = |header: &str| header.trim_end_matches(',').split(',').count();
        let cells = |header: &str| vec![number; width(header)];
        format!("{first}\n{}{second}\n{}", rows(400, ",", &cells(first)), rows(200, ",", &cells(second)))
    };
    for (first, second) in [
        ("time,lat,lon,alt", "time,ax,ay,az"),
        ("time,id,lat,lon,alt,hdop", "time,id,ax,ay,az,temp"),
        ("t,x,y,z", "seq,x,t,src"),
        ("t,a1,b1,end", "n1,a1,t,last"),
        ("t,a,b", "t,x,y,"),
        ("# t,alt,spd", "# t,spd,vario"),
    ] {
        for end in ["", "# \"end\"\n"] {
            let log = read(&(text(first, second) + end));
            assert!(log.notices.iter().any(|n| n.severity == Severity::Loss), "{second}: {:#?}", log.notices);
            assert_eq!((log.tables[0].rows, log.health.undecodable), (400, 201), "{second}");
            for name in first.trim_start_matches("# ").split(',') {
                assert_eq!(numbers(&log, name).iter().flatten().count(), 400, "{second}: {name}");
            }
        }
    }
    // Rows of words are rows, and cost no later rows.
    for odd in [
        "ERR,ERR,ERR",
        "nan,inf,N/A",
        "x,,",
        "deg,deg,m",
        "ok,1,2",
        "OVERLOAD,OPEN,SHORT",
        "WARNING,low,battery",
        "float,int,double",
        "# landed, a, b",
        "t,sync lost",
        "ERR,ERR,b",
    ] {
        let text = format!("t,a,b\n{0}{odd}\n{0}", rows(40, ",", &[number; 3]));
        for end in ["", "# \"end\"\n"] {
            let log = read(&format!("{text}{end}"));
            let short = odd.split(',').count() < 3;
            let expected = if odd.starts_with('#') || short { 80 } else { 81 };
            assert_eq!((log.tables[0].rows, log.health.undecodable), (expected, u64::from(short)), "{odd}");
        }
    }
    let log = read(&format!("time,mode,armed\n{}", "2024-05-10T10:01:40Z,AUTO,armed\n".repeat(60)));
    assert_eq!((log.tables[0].rows, log.health.undecodable), (60, 0));
    let log = read(&format!("mode,alt\nINIT,NOFIX\n{}INIT,NOFIX\n", "AUTO,1\n".repeat(30)));
    assert_eq!((log.tables[0].rows, log.health.undecodable), (32, 0));
    let log = read(&format!("t,mode\n{}", "1,arm\n2,mode\n3,t\n".repeat(30)));
    assert_eq!((log.tables[0].rows, log.health.undecodable), (90, 0));
}

#[test]
fn rows_with_quotes_and_no_header_are_rows() {
    for cell in [|i: u32| format!("\"{i}\""), |i: u32| if i % 10 == 3 { "\"7\"".to_owned() } else { i.to_string() }] {
        let text: String = (0..200).map(|i| format!("{i},{},0.5\n", cell(i))).collect();
        let log = read(&text);
        assert_eq!((log.health.messages, log.health.bytes.damaged), (200, 0), "{:?}", log.health.damage);
        assert_eq!(numbers(&log, "column_3"), vec![Some(0.5); 200]);
    }
    let text: String = (0..200).map(|i| format!("{i},\"mode, {i}\",0.5\n")).collect();
    assert_eq!(read(&text).health.messages, 200);
}

#[test]
fn if_a_remark_names_the_columns_rows_without_numbers_are_rows() {
    let cells = |i: u32| if i < 2 { ",".to_owned() } else { format!("47.1,8.{i}") };
    let times: String = (0..60).map(|i| format!("12:00:{i:02}.0,{},INIT\n", cells(i))).collect();
    let log = read(&format!("#utc,lat,lon,mode\n{times}"));
    assert_eq!((log.health.messages, log.health.bytes.damaged), (60, 0));
    assert_eq!(numbers(&log, "lat")[..3], [None, None, Some(47.1)]);
    let events: String = (0..40).map(|i| format!("2024-03-01T12:00:{i:02}Z,MODE,state {i}\n")).collect();
    let log = read(&format!("# time,event,detail\n{events}"));
    assert_eq!(log.health.messages, 40);
    assert!(log.tables[0].column("detail").is_some());
    // Without such a remark the first line is the header, dates or not.
    let log = read(&format!("time,event,detail\n{events}"));
    assert_eq!((log.health.messages, log.tables[0].columns.len()), (40, 3));
}

#[test]
fn the_last_name_of_a_marked_header_may_be_missing() {
    let rows: String = (0..200).map(|i| format!("{i}\t{}\t0.5\t\n", 100 + i)).collect();
    let log = read(&format!("# t\talt\tspd\t\n{rows}"));
    assert_eq!((log.health.messages, numbers(&log, "spd")), (200, vec![Some(0.5); 200]));
    assert!(log.health.format.contains("header in line 1"), "{}", log.health.format);
}

#[test]
fn units_are_distinguished_from_rows_in_unusual_layouts() {
    let row = |i: u32| format!("{i}.0,12,{i},{i}\n");
    let header = "time,volt,cur,alt\ns,V,A,m\n";
    let plain: String = (0..200).map(row).collect();
    let again: String = (0..200).map(|i| format!("{}{}", if i == 10 { header } else { "" }, row(i))).collect();
    let one = |i: u32, every: u32| if i.is_multiple_of(every) { String::new() } else { i.to_string() };
    let sparse: String =
        (0..200).map(|i| format!("12:00:{:02},{},{},{}\n", i % 60, one(i, 2), one(i, 3), one(i, 5))).collect();
    for text in [
        format!("{header}{again}"),
        format!("time,volt,cur,alt\n-,V,A,m\n{sparse}"),
        format!("# a,b,c,d\n{header}{plain}"),
    ] {
        let log = read(&text);
        assert_eq!((log.health.messages, log.health.bytes.damaged), (200, 0), "{}", log.health.format);
        assert!(log.health.format.contains("units in line"), "{}", log.health.format);
        assert_eq!(numbers(&log, "alt")[7], Some(7.0));
    }
}

#[test]
fn doubtful_lines_below_a_remark_or_with_gaps_keep_their_meaning() {
    // Names that begin with a digit.
    let rows: String = (0..100).map(|i| format!("{i}.5,{i},5.0\n")).collect();
    for header in ["# sec,meters,volts\ntime,alt,5V_rail\n", "# Flight log, firmware x, board y\ntime,3d_fix,alt\n"] {
        let log = read(&format!("{header}{rows}"));
        assert_eq!((log.health.messages, numbers(&log, "time")[1]), (100, Some(1.5)), "{header}");
    }
    // Events are not units.
    let events: String = (0..100).map(|i| format!("P{i},{}\n", if i % 2 == 0 { "" } else { "7" })).collect();
    assert_eq!(read(&format!("event,value\nFIRMWARE,v43\n{events}")).health.messages, 101);
    let sparse: String = (0..100).map(|i| format!("MODE,auto,{}\n", if i % 2 == 0 { "" } else { "7" })).collect();
    assert_eq!(read(&format!("what,how,alt\nARM,by stick,ground\n{sparse}")).health.messages, 101);
    // A TAB after the names or the units, but not after the rows.
    let tabs: String = (0..100).map(|i| format!("{i}\t{i}\t7\n")).collect();
    for header in ["# t\talt\tspd\t\n", "# t\talt\tspd\t\n# s\tm\tm/s\t\n", "t\talt\tspd\n# s\tm\tm/s\t\n"] {
        let log = read(&format!("{header}{tabs}"));
        assert_eq!((log.health.messages, numbers(&log, "spd")), (100, vec![Some(7.0); 100]), "{header}");
        assert_eq!(log.health.format.contains("units in"), header.contains("m/s"), "{}", log.health.format);
    }
}

#[test]
fn the_delimiter_line_for_spreadsheets_is_not_a_header() {
    for (hint, delimiter) in [("sep=;", ";"), ("sep=,", ","), ("SEP=;", ";")] {
        let rows: String = (0..50).map(|i| format!("{i}{delimiter}{i}.5\n")).collect();
        let log = read(&format!("{hint}\nt{delimiter}a\n{rows}"));
        assert_eq!((log.health.messages, numbers(&log, "a")[3]), (50, Some(3.5)), "{hint}");
        let log = read(&format!("{hint}\n{rows}"));
        assert_eq!((log.health.messages, log.health.bytes.damaged), (50, 0), "{hint}");
    }
}
