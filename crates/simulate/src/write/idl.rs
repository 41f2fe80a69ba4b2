//! Message definitions in OMG IDL, as `rosidl` generates them from `.msg` files.

use super::definition::Definition;

/// The definition of a type and its nested types, each after a line of `=` and its name, as rosbag2 stores them.
pub(super) fn text(definition: &Definition) -> String {
    let line = "=".repeat(80);
    let whole = format!("MSG: {}\n{}", definition.ros1_name(), definition.ros2_text());
    let separator = format!("{line}\n");
    let files = whole.split(&separator).filter_map(|part| {
        let (name, body) = part.strip_prefix("MSG: ")?.split_once('\n')?;
        let (package, own) = name.trim().split_once('/')?;
        Some(format!("{line}\nIDL: {package}/msg/{own}\n{}", file(package, own, body)))
    });
    files.collect::<Vec<String>>().join("\n")
}

fn file(package: &str, name: &str, body: &str) -> String {
    let (mut typedefs, mut constants, mut members) = (String::new(), String::new(), String::new());
    for line in body.lines().map(|line| line.split('#').next().unwrap_or_default().trim()).filter(|l| !l.is_empty()) {
        let Some((of, rest)) = line.split_once(char::is_whitespace) else { continue };
        if let Some((constant, value)) = rest.split_once('=') {
            let (constant, value) = (constant.trim(), value.trim());
            constants += &format!("      const {} {constant} = {value};\n", idl_type(package, of));
            continue;
        }
        let (base, size) = of.split_once('[').map_or((of, None), |(base, size)| (base, Some(size)));
        let plain = idl_type(package, base);
        let of = match size.map(|size| size.trim_end_matches(']')) {
            None => plain,
            Some("") => format!("sequence<{plain}>"),
            Some(size) => {
                let own = format!("{}__{size}", plain.replace([' ', ':'], "_"));
                let typedef = format!("    typedef {plain} {own}[{size}];\n");
                if !typedefs.contains(&typedef) {
                    typedefs += &typedef;
                }
                own
            }
        };
        members += &format!(
            "      @verbatim (language=\"comment\", text=\n        \"{} (of a \\\"message\\\");\")\n      {of} {};\n",
            rest.trim(),
            rest.trim()
        );
    }
    let constants =
        if constants.is_empty() { constants } else { format!("    module {name}_Constants {{\n{constants}    }};\n") };
    format!(
        "// generated from rosidl_adapter/resource/msg.idl.em\n#include \"builtin_interfaces/msg/Time.idl\"\n\n\
         module {package} {{\n  module msg {{\n{typedefs}{constants}    /* {name} */\n    struct {name} {{\n{members}    }};\n  \
         }};\n}};\n"
    )
}

fn idl_type(package: &str, of: &str) -> String {
    match of {
        "float64" => "double".to_owned(),
        "float32" => "float".to_owned(),
        "bool" => "boolean".to_owned(),
        "byte" => "octet".to_owned(),
        "int64" => "long long".to_owned(),
        "uint32" => "unsigned long".to_owned(),
        "string" | "wstring" | "char" => of.to_owned(),
        // The names with the number of bits are equivalent: IDL 4.2, 7.4.13.
        number if number.starts_with("int") || number.starts_with("uint") => number.to_owned(),
        named => match named.split_once('/') {
            Some((package, name)) => format!("{package}::msg::{name}"),
            None => format!("{package}::msg::{named}"),
        },
    }
}
