//! Layouts that open the MCAP of a track in Foxglove (and Lichtblick) and in `PlotJuggler`.

use super::map_files::{COLOURS, escaped};
use super::{LINES, Track};
use serde_json::{Value, json};

/// A map with both lines, and latitude and longitude over time.
pub(super) fn foxglove(track: &Track) -> String {
    let topic = |line: usize| format!("/{}/fix", LINES[line].0);
    let colours: serde_json::Map<String, Value> =
        COLOURS.iter().enumerate().map(|(line, colour)| (topic(line), json!(format!("#{colour}")))).collect();
    let centre = track.instants.iter().find_map(|i| i.places[0].or(i.places[1]));
    let centre = centre.map(|place| json!({ "lat": place.latitude_deg, "lon": place.longitude_deg }));
    let map = json!({
        "center": centre, "zoomLevel": 15, "layer": "map", "customTileUrl": "", "followTopic": "",
        // Both encodings hold the same positions: one of them is enough.
        "disabledTopics": LINES.map(|(name, ..)| format!("/{name}/location")), "topicColors": colours,
    });
    let plot = |field: &str| {
        let path = |(line, colour): (usize, &&str)| {
            json!({
                "value": format!("{}.{field}", topic(line)), "label": LINES[line].0, "enabled": true,
                "timestampMethod": "headerStamp", "color": format!("#{colour}"),
            })
        };
        json!({
            "foxglovePanelTitle": format!("{field} (deg)"), "lichtblickPanelTitle": format!("{field} (deg)"), "paths": COLOURS.iter().enumerate().map(path).collect::<Vec<_>>(),
            "xAxisVal": "timestamp", "isSynced": true, "showXAxisLabels": true, "showYAxisLabels": true,
            "showLegend": true, "legendDisplay": "floating", "showPlotValuesInLegend": true, "sidebarDimension": 240,
        })
    };
    let layout = json!({
        "configById": { "map!track": map, "Plot!latitude": plot("latitude"), "Plot!longitude": plot("longitude") },
        "globalVariables": {}, "userNodes": {}, "playbackConfig": { "speed": 1 },
        "layout": {
            "direction": "row", "splitPercentage": 55, "first": "map!track",
            "second": { "direction": "column", "first": "Plot!latitude", "second": "Plot!longitude" },
        },
    });
    format!("{layout:#}\n")
}

/// The same for `PlotJuggler`, which then also loads the MCAP next to the layout.
pub(super) fn plotjuggler(recording: &str) -> String {
    let curve = |line: usize, field: &str| {
        format!("       <curve name=\"/{}/fix/{field}\" color=\"#{}\"/>\n", LINES[line].0, COLOURS[line])
    };
    let over_time = |field: &str| {
        let curves: String = (0..LINES.len()).map(|line| curve(line, field)).collect();
        area("TimeSeries", &curves)
    };
    let track: String = (0..LINES.len())
        .map(|line| {
            let (name, colour) = (LINES[line].0, COLOURS[line]);
            format!(
                "       <curve name=\"{name}\" curve_x=\"/{name}/fix/longitude\" curve_y=\"/{name}/fix/latitude\" color=\"#{colour}\"/>\n"
            )
        })
        .collect();
    let topics = LINES.map(|(name, ..)| format!("/{name}/fix")).join(";");
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<root>\n <tabbed_widget name=\"Main Window\" parent=\"main_window\">\n  \
         <Tab tab_name=\"track\" containers=\"1\">\n   <Container>\n    \
         <DockSplitter orientation=\"|\" count=\"2\" sizes=\"0.5;0.5\">\n{}     \
         <DockSplitter orientation=\"-\" count=\"2\" sizes=\"0.5;0.5\">\n{}{}     </DockSplitter>\n    </DockSplitter>\n   \
         </Container>\n  </Tab>\n  <currentTabIndex index=\"0\"/>\n </tabbed_widget>\n <use_relative_time_offset enabled=\"1\"/>\n \
         <previouslyLoaded_Datafiles>\n  <fileInfo filename=\"{}\" prefix=\"\">\n   <selected_datasources value=\"{topics}\"/>\n   \
         <plugin ID=\"DataLoad MCAP\">\n    <parameters use_timestamp=\"1\" use_mcap_log_time=\"1\" clamp_large_arrays=\"1\" \
         max_array_size=\"500\" selected_topics=\"{topics}\"/>\n   </plugin>\n  </fileInfo>\n </previouslyLoaded_Datafiles>\n</root>\n",
        area("XYPlot", &track),
        over_time("latitude"),
        over_time("longitude"),
        escaped(recording),
    )
}

fn area(mode: &str, curves: &str) -> String {
    format!(
        "     <DockArea name=\"...\">\n      <plot style=\"Lines\" mode=\"{mode}\" flip_x=\"false\" flip_y=\"false\">\n       \
         <limitY/>\n{curves}      </plot>\n     </DockArea>\n"
    )
}
