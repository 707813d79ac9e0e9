//! Hashes of the types that the node announces (REP 2011), by which others tell whether they mean the same type: `ros2
//! topic info -v` shows them. `tools/ros2-hashes` takes them from what `rosidl` makes of each type of its list.

/// In each line the name of a type in ROS, and its hash; the types are sorted.
const TABLE: &str = include_str!("type_hashes.txt");

/// What an endpoint has others know in DDS of a type that is called so there, as `nav_msgs::msg::dds_::Odometry_`, in
/// the form of `rmw_dds_common`; nothing if the table does not have the type.
#[must_use]
pub fn user_data(dds_type: &str) -> Vec<u8> {
    find(dds_type).map_or_else(Vec::new, |hash| format!("typehash={hash};").into_bytes())
}

fn find(dds_type: &str) -> Option<&'static str> {
    let name = dds_type.strip_suffix('_')?.replace("::dds_::", "::").replace("::", "/");
    TABLE.lines().find_map(|line| line.strip_prefix(&*name)?.strip_prefix(' '))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_of_the_table_has_the_data_that_ros_gives_it_and_another_one_has_none() {
        // As rclpy 9.1.2 announces it.
        let text = "typehash=RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18;";
        assert_eq!(user_data("std_msgs::msg::dds_::String_"), text.as_bytes());
        let setbool = ["Request", "Response"].map(|part| format!("std_srvs::srv::dds_::SetBool_{part}_"));
        let [request, response] = setbool.map(|name| user_data(&name));
        assert!(request.len() == text.len() && response.len() == text.len() && request != response);
        for unknown in ["std_msgs::msg::dds_::Strin_", "std_msgs::msg::dds_::String", "std_msgs/msg/String", "_", ""] {
            assert!(user_data(unknown).is_empty(), "{unknown}");
        }
    }

    #[test]
    fn the_table_is_sorted_and_each_of_its_hashes_is_one_of_rihs01() {
        let lines: Vec<&str> = TABLE.lines().filter(|line| !line.starts_with('#')).collect();
        assert!(lines.is_sorted());
        for line in lines {
            let hash = line.split_once(' ').and_then(|(_, hash)| hash.strip_prefix("RIHS01_")).unwrap();
            assert!(hash.len() == 64 && hash.chars().all(|digit| digit.is_ascii_hexdigit()), "{line}");
        }
    }
}
