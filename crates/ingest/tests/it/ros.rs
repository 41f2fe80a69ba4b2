//! ROS messages: our decoders against those of the Python packages, on real logs.

use crate::made::{reader, sum, whole_sum};
use crate::support::{in_context, real_logs};
use ingest::{Selection, TopicInfo};

#[test]
fn values_of_real_messages_are_those_of_the_python_decoder() {
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
        let log = in_context(|c| reader(path, is_bag).read(&want, c)).unwrap();
        let table = &log.tables[0];
        assert_eq!(table.columns.len(), sums.len() + 1, "{file}");
        assert_eq!(whole_sum(table, stamp), stamps, "{file}");
        for &(path, count, total) in sums {
            assert_eq!(sum(table, path), (count, total), "{file} {path}");
        }
    }
}
