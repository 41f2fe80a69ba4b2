//! Message definitions as ROS 1 and ROS 2 recorders store them: the type's own text, then that of
//! each type within it below a line of `=`.

/// `sensor_msgs/NavSatFix`.
pub(crate) const NAV_SAT_FIX: Definition = Definition {
    package: "sensor_msgs",
    name: "NavSatFix",
    md5: "2d3a8cd499b9b4a0249fb98fd05cfa48",
    text: include_str!("msg/NavSatFix.msg"),
    parts: &[HEADER, ("sensor_msgs/NavSatStatus", include_str!("msg/NavSatStatus.msg"))],
};

/// `geometry_msgs/TwistStamped`.
pub(crate) const TWIST_STAMPED: Definition = Definition {
    package: "geometry_msgs",
    name: "TwistStamped",
    md5: "98d34b0043a2093cf9d9345ab6eef12e",
    text: include_str!("msg/TwistStamped.msg"),
    parts: &[
        HEADER,
        ("geometry_msgs/Twist", include_str!("msg/Twist.msg")),
        ("geometry_msgs/Vector3", include_str!("msg/Vector3.msg")),
    ],
};

/// `std_msgs/String`.
pub(crate) const STRING: Definition = Definition {
    package: "std_msgs",
    name: "String",
    md5: "992ce8a1687cec8c8bd883ec73ca41d1",
    text: "string data\n",
    parts: &[],
};

const HEADER: (&str, &str) = ("std_msgs/Header", "");
const HEADER_ROS1: &str = include_str!("msg/Header.ros1.msg");
const HEADER_ROS2: &str = include_str!("msg/Header.ros2.msg");
const TIME_ROS2: &str = include_str!("msg/Time.ros2.msg");

/// A message type.
#[derive(Debug)]
pub(crate) struct Definition {
    package: &'static str,
    name: &'static str,
    /// Sum that ROS 1 knows the type by.
    pub(crate) md5: &'static str,
    text: &'static str,
    parts: &'static [(&'static str, &'static str)],
}

impl Definition {
    /// Name in ROS 1.
    pub(crate) fn ros1_name(&self) -> String {
        format!("{}/{}", self.package, self.name)
    }

    /// Name in ROS 2.
    pub(crate) fn ros2_name(&self) -> String {
        format!("{}/msg/{}", self.package, self.name)
    }

    /// Text in ROS 1, where `Header` needs no package and has a sequence number.
    pub(crate) fn ros1_text(&self) -> String {
        let parts = self.parts.iter().map(|&(name, text)| (name, if name == HEADER.0 { HEADER_ROS1 } else { text }));
        concatenated(&self.text.replace("std_msgs/Header header", "Header header"), parts)
    }

    /// Text in ROS 2, where a header's time is a message.
    pub(crate) fn ros2_text(&self) -> String {
        let parts = self.parts.iter().flat_map(|&(name, text)| {
            let with_time = (name == HEADER.0).then_some(("builtin_interfaces/Time", TIME_ROS2));
            [(name, if name == HEADER.0 { HEADER_ROS2 } else { text })].into_iter().chain(with_time)
        });
        concatenated(self.text, parts)
    }
}

fn concatenated<'a>(root: &str, parts: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let line = "=".repeat(80);
    parts.fold(root.to_owned(), |all, (name, text)| format!("{all}\n{line}\nMSG: {name}\n{text}"))
}
