//! The layouts of a track's MCAP, checked against the rules by which the programs read them. The rules are from the
//! sources of Lichtblick (`validateLayoutData`, the panels `map` and `Plot`) and of `PlotJuggler`
//! (`loadLayoutFromFile`, `restoreSplitter`, `PlotWidget::xmlLoadState`, `DataLoadMCAP`).

use crate::track::write;
use convert::{TrackOrder, TrackTo, export_track, layouts_of};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;

/// Files of a track: the schema of each topic of the MCAP, and the layouts.
struct Written {
    recording: String,
    topics: BTreeMap<String, String>,
    foxglove: Value,
    plotjuggler: Element,
}

fn written(name: &str) -> Written {
    let folder = tempfile::tempdir().unwrap();
    let (track, out) = (folder.path().join("track.parquet"), folder.path().join(name));
    write(&track, true);
    export_track(&TrackOrder { track: &track, name: "a", to: TrackTo::Mcap, most_hz: None, out: &out }).unwrap();
    let bytes = fs::read(&out).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let topics =
        summary.channels.values().map(|c| (c.topic.clone(), c.schema.as_ref().unwrap().name.clone())).collect();
    let [foxglove, plotjuggler] = layouts_of(&out).map(|path| fs::read_to_string(path).unwrap());
    Written {
        recording: name.to_owned(),
        topics,
        foxglove: serde_json::from_str(&foxglove).unwrap(),
        plotjuggler: Element::read(&plotjuggler),
    }
}

/// Numeric fields of `NavSatFix`.
const FIELDS: [&str; 3] = ["latitude", "longitude", "altitude"];

#[test]
fn foxglove_and_lichtblick_find_every_panel_topic_and_field() {
    let Written { topics, foxglove: layout, .. } = written("track.mcap");
    for name in ["configById", "globalVariables", "userNodes", "playbackConfig"] {
        assert!(layout[name].is_object(), "{name}");
    }
    assert!(layout["playbackConfig"]["speed"].is_number());
    let panels = layout["configById"].as_object().unwrap();
    let mut leaves = BTreeSet::new();
    mosaic(&layout["layout"], &mut leaves);
    assert_eq!(leaves, panels.keys().cloned().collect());
    for (id, config) in panels {
        match id.split('!').next().unwrap() {
            "map" => {
                assert!(config["center"]["lat"].is_number() && config["center"]["lon"].is_number());
                assert!(["map", "satellite", "custom"].contains(&config["layer"].as_str().unwrap()));
                let disabled = config["disabledTopics"].as_array().unwrap().iter().map(|t| t.as_str().unwrap());
                let coloured = config["topicColors"].as_object().unwrap().keys().map(String::as_str);
                assert!(disabled.chain(coloured).all(|topic| topics.contains_key(topic)), "{config}");
                assert!(config["customTileUrl"].is_string() && config["followTopic"].is_string());
            }
            "Plot" => plot(config, &topics),
            other => panic!("no panel is called {other}"),
        }
    }
}

/// A leaf is a panel's id; a parent has a direction and two children.
fn mosaic(node: &Value, leaves: &mut BTreeSet<String>) {
    match node {
        Value::String(id) => assert!(leaves.insert(id.clone()), "{id} appears twice"),
        parent => {
            assert!(["row", "column"].contains(&parent["direction"].as_str().unwrap()));
            assert!((1.0..100.0).contains(&parent["splitPercentage"].as_f64().unwrap_or(50.0)));
            mosaic(&parent["first"], leaves);
            mosaic(&parent["second"], leaves);
        }
    }
}

fn plot(config: &Value, topics: &BTreeMap<String, String>) {
    assert!(["timestamp", "index", "custom", "currentCustom"].contains(&config["xAxisVal"].as_str().unwrap()));
    assert!(["floating", "top", "left", "none"].contains(&config["legendDisplay"].as_str().unwrap()));
    let flags = ["isSynced", "showLegend", "showPlotValuesInLegend", "showXAxisLabels", "showYAxisLabels"];
    assert!(flags.iter().all(|flag| config[flag].is_boolean()) && config["sidebarDimension"].is_number());
    // The two programs use different keys for the title.
    assert!(["foxglovePanelTitle", "lichtblickPanelTitle"].iter().all(|key| config[key].is_string()), "{config}");
    for path in config["paths"].as_array().unwrap() {
        let (topic, field) = path["value"].as_str().unwrap().rsplit_once('.').unwrap();
        assert_eq!(topics[topic], "sensor_msgs/msg/NavSatFix");
        assert!(FIELDS.contains(&field) && path["enabled"].is_boolean());
        assert!(["receiveTime", "headerStamp"].contains(&path["timestampMethod"].as_str().unwrap()));
    }
}

#[test]
fn plotjuggler_finds_the_recording_every_dock_and_every_curve() {
    let Written { recording, topics, plotjuggler: root, .. } = written("a & b.mcap");
    assert_eq!(root.tag, "root");
    let tabs = root.only("tabbed_widget");
    assert_eq!((tabs.attribute("parent"), tabs.attribute("name")), ("main_window", "Main Window"));
    let mut curves = 0;
    for tab in tabs.all("Tab") {
        for container in tab.all("Container") {
            docks(container.only("DockSplitter"), &topics, &mut curves);
        }
    }
    assert_eq!(curves, 6, "two lines in three plots");
    assert!(tabs.only("currentTabIndex").attribute("index").parse::<usize>().unwrap() < tabs.all("Tab").len());
    let file = root.only("previouslyLoaded_Datafiles").only("fileInfo");
    // A relative name is resolved next to the layout.
    assert_eq!((file.attribute("filename"), file.attribute("prefix")), (recording.as_str(), ""));
    let plugin = file.only("plugin");
    assert_eq!(plugin.attribute("ID"), "DataLoad MCAP");
    let parameters = plugin.only("parameters");
    for flag in ["use_timestamp", "use_mcap_log_time", "clamp_large_arrays"] {
        assert!(["0", "1"].contains(&parameters.attribute(flag)), "{flag}");
    }
    assert!(parameters.attribute("max_array_size").parse::<u32>().is_ok());
    let selected: Vec<&str> = parameters.attribute("selected_topics").split(';').collect();
    assert!(!selected.is_empty() && selected.iter().all(|topic| topics.contains_key(*topic)), "{selected:?}");
}

/// A splitter has as many sizes and children as it states; each child is a splitter or a plot.
fn docks(splitter: &Element, topics: &BTreeMap<String, String>, curves: &mut usize) {
    let count: usize = splitter.attribute("count").parse().unwrap();
    let sizes: Vec<f64> = splitter.attribute("sizes").split(';').map(|size| size.parse().unwrap()).collect();
    assert!(["|", "-"].contains(&splitter.attribute("orientation")));
    assert_eq!((splitter.children.len(), sizes.len()), (count, count));
    assert!((sizes.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    for child in &splitter.children {
        match child.tag.as_str() {
            "DockSplitter" => docks(child, topics, curves),
            "DockArea" => *curves += curves_of(child.only("plot"), topics),
            other => panic!("no dock is called {other}"),
        }
    }
}

/// A series of a topic is named `/topic/field`.
fn curves_of(plot: &Element, topics: &BTreeMap<String, String>) -> usize {
    let is_series = |name: &str| {
        let (topic, field) = name.rsplit_once('/').unwrap();
        topics.get(topic).is_some_and(|schema| schema == "sensor_msgs/msg/NavSatFix") && FIELDS.contains(&field)
    };
    assert!(["Lines", "Dots", "LinesAndDots", "Sticks", "Steps", "StepsInv"].contains(&plot.attribute("style")));
    for curve in plot.all("curve") {
        match plot.attribute("mode") {
            "XYPlot" => assert!(["curve_x", "curve_y"].iter().all(|axis| is_series(curve.attribute(axis)))),
            "TimeSeries" => assert!(is_series(curve.attribute("name"))),
            other => panic!("no mode is called {other}"),
        }
        let colour = curve.attribute("color");
        assert!(colour.len() == 7 && colour.starts_with('#'), "{colour}");
    }
    plot.all("curve").len()
}

/// An element of the layout's XML: no text, attributes in double quotes.
struct Element {
    tag: String,
    attributes: BTreeMap<String, String>,
    children: Vec<Element>,
}

impl Element {
    fn read(xml: &str) -> Element {
        let mut open = vec![Element { tag: String::new(), attributes: BTreeMap::new(), children: vec![] }];
        for part in xml.split('<').skip(1).filter(|part| !part.starts_with('?')) {
            let (inside, rest) = part.split_once('>').unwrap();
            assert_eq!(rest.trim(), "", "text between elements");
            if let Some(tag) = inside.strip_prefix('/') {
                let element = open.pop().unwrap();
                assert_eq!(element.tag, tag);
                open.last_mut().unwrap().children.push(element);
                continue;
            }
            let (body, is_closed) = inside.strip_suffix('/').map_or((inside, false), |body| (body, true));
            let element = Element::opened(body);
            match is_closed {
                true => open.last_mut().unwrap().children.push(element),
                false => open.push(element),
            }
        }
        assert_eq!(open.len(), 1, "every element is closed");
        open.pop().unwrap().children.pop().unwrap()
    }

    fn opened(body: &str) -> Element {
        let (tag, mut rest) = body.split_once(' ').unwrap_or((body, ""));
        let mut attributes = BTreeMap::new();
        while let Some((name, after)) = rest.split_once("=\"") {
            let (value, after) = after.split_once('"').unwrap();
            let plain = value.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&");
            attributes.insert(name.trim().to_owned(), plain);
            rest = after;
        }
        Element { tag: tag.to_owned(), attributes, children: vec![] }
    }

    fn attribute(&self, name: &str) -> &str {
        self.attributes.get(name).unwrap_or_else(|| panic!("<{}> has no {name}", self.tag))
    }

    fn all(&self, tag: &str) -> Vec<&Element> {
        self.children.iter().filter(|child| child.tag == tag).collect()
    }

    fn only(&self, tag: &str) -> &Element {
        let all = self.all(tag);
        assert_eq!(all.len(), 1, "<{tag}> in <{}>", self.tag);
        all[0]
    }
}
