//! ROS messages: our decoders against those of the Python packages, on real logs.

use crate::made::{read_at, sum, whole_sum};
use crate::support::{assert_ledger, file, in_context, load, real_logs};
use ingest::{FlightUnit, LogKind, Selection, TopicInfo};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;

#[test]
fn real_messages_have_the_values_of_the_python_decoder() {
    // rosbags 0.11.9, deserialize_ros1 and math.fsum.
    type Sums = &'static [(&'static str, usize, f64)];
    let cases: [(&str, &str, &str, i128, Sums); 4] = [
        (
            "robot_localization/test/test1.bag",
            "/fix",
            "header.stamp",
            1_416_481_102_983_320_759_754,
            &[
                ("latitude", 989, 41910.347555),
                ("altitude", 989, -17940.3),
                ("position_covariance[8]", 989, 3054.6400000000003),
                ("status.service", 989, 989.0),
                ("header.seq", 989, 588_455.0),
            ],
        ),
        (
            "robot_localization/test/test1.bag",
            "/husky_velocity_controller/odom",
            "header.stamp",
            5_660_195_469_344_811_447_609,
            &[
                ("pose.pose.position.x", 3952, 261_283.805_675_115_23),
                ("twist.twist.angular.z", 3952, -34.566_455_391_384_51),
                ("twist.covariance[35]", 3952, 118.56),
            ],
        ),
        (
            "PlotJuggler/datasamples/tilt_laser.bag",
            "/tf",
            "transforms[0].header.stamp",
            943_425_571_030_905_724_095,
            &[("transforms[0].transform.rotation.z", 711, -0.712)],
        ),
        (
            "derived-alfa/alfa_mcap_ros2/alfa_mcap_ros2.mcap",
            // mcap-ros2-support 0.6.0.
            "/mavros/global_position/raw/fix",
            "header.stamp",
            1_014_146_846_606_356_856_315,
            &[("latitude", 662, 26_871.748_662_5), ("position_covariance[8]", 662, 951.038_346_605_160_1)],
        ),
    ];
    for (file, topic, stamp, stamps, sums) in cases {
        let Some(path) = real_logs(file) else { continue };
        let paths = sums.iter().map(|s| s.0).chain([stamp]);
        let fields: Vec<_> =
            paths.map(|p| ingest::FieldRequest { path: p.to_owned(), kind: ingest::ValueKind::Number }).collect();
        let want = |t: &TopicInfo| {
            if t.name == topic { Selection::Fields(fields.clone()) } else { Selection::Skip }
        };
        let is_bag = file.ends_with(".bag");
        let log = in_context(|c| read_at(path, is_bag, &want, c)).unwrap();
        let table = &log.tables[0];
        assert_eq!(table.columns.len(), sums.len() + 1, "{file}");
        assert_eq!(whole_sum(table, stamp), stamps, "{file}");
        for &(path, count, total) in sums {
            assert_eq!(sum(table, path), (count, total), "{file} {path}");
        }
    }
}

/// A `std_msgs/Header` in CDR with its encapsulation header, then 16 bytes.
fn header(second: u32) -> Vec<u8> {
    [&[0, 1, 0, 0][..], &[second, 0, 4].map(u32::to_le_bytes).concat(), b"imu\0"].concat()
}

fn fix(second: u32) -> Vec<u8> {
    let place = [47.0 + 1e-5 * f64::from(second), 8.0, 400.0];
    let numbers: Vec<u8> = place.into_iter().chain([0.0; 9]).flat_map(f64::to_le_bytes).collect();
    [header(second), vec![0; 8], numbers, vec![0]].concat()
}

/// An IMU at rest; `covariances` are the first numbers of the three.
fn imu(second: u32, covariances: [f64; 3]) -> Vec<u8> {
    let values: [&[f64]; 3] = [&[0.0, 0.0, 0.0, 1.0], &[0.1, 0.2, 0.3], &[0.0, 0.0, 9.81]];
    let parts = values.iter().zip(covariances).flat_map(|(value, first)| [value, &[first][..], &[0.0; 8]].concat());
    [header(second), parts.flat_map(f64::to_le_bytes).collect()].concat()
}

/// "Please check for a value of -1 in the first element of each covariance matrix, and disregard the associated estimate"
/// (sensor_msgs/msg/Imu.msg).
#[test]
fn values_marked_as_not_estimated_are_not_used() {
    const COUNT: u32 = 50;
    let channels = ["attitude.imu", "angular-rate.imu", "specific-force.imu"];
    for without in 0..4 {
        let covariances = [0, 1, 2].map(|i| if i == without { -1.0 } else { 0.01 * i as f64 });
        let mut writer = mcap::Writer::new(std::io::Cursor::new(vec![])).unwrap();
        let mut channel = |topic: &str, type_name: &str| {
            let schema = writer.add_schema(type_name, "", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        };
        let ids = [channel("/fix", "sensor_msgs/msg/NavSatFix"), channel("/imu", "sensor_msgs/msg/Imu")];
        for second in 0..COUNT {
            let log_time = u64::from(second) * 1_000_000_000 + 5;
            for (channel_id, payload) in ids.into_iter().zip([fix(second), imu(second, covariances)]) {
                let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
                writer.write_to_known_channel(&header, &payload).unwrap();
            }
        }
        writer.finish().unwrap();
        let (_folder, path) = file("imu.mcap", &writer.into_inner().into_inner());
        let loaded = load(&FlightUnit { id: "imu".to_owned(), files: vec![path], kind: LogKind::Mcap }).unwrap();
        assert_ledger(&loaded);
        let bound = &loaded.binding.as_ref().unwrap().channels;
        for (index, name) in channels.iter().enumerate() {
            let used = bound.iter().find(|c| c.name == *name).unwrap_or_else(|| panic!("no {name}")).used;
            assert_eq!(used, if index == without { 0 } else { u64::from(COUNT) }, "{name} of {covariances:?}");
        }
    }
}
