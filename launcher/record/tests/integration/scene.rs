//! What viewers receive, taken apart again with descriptors alone.

use core::f64::consts::FRAC_PI_2;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use prost_reflect::{DescriptorPool, DynamicMessage, Value};
use record::scene::{CHANNELS, LAYOUT, Scene, plotjuggler_layout};
use shared_types::wire::{Kind, Schema};
use shared_types::{
    ActuatorState, Disturbance, Header, Quaternion, Reference, ReferencePoint, Sample, Topic,
    TopicVisitor, Truth, topics,
};
use std::collections::BTreeMap;
use vehicle::{Geometry, MorphAngle, VehicleParameters};

fn header(release_ns: u64) -> Header {
    Header { sequence: 1, release_ns, ..Header::default() }
}

/// Messages by the name of their channel, decoded.
fn shown<T: Sample>(scene: &mut Scene, sample: &T) -> BTreeMap<&'static str, DynamicMessage> {
    let decode = |(channel, bytes): (usize, Vec<u8>)| {
        let channel = &CHANNELS[channel];
        let schema = (channel.schema)().unwrap();
        assert_eq!(schema.encoding, "protobuf");
        let pool = DescriptorPool::decode(&*schema.data).unwrap();
        let message = pool.get_message_by_name(&schema.name).unwrap();
        (channel.name, DynamicMessage::decode(message, &*bytes).unwrap())
    };
    scene.observe(sample, 1_700_000_000_250_000_000).into_iter().map(decode).collect()
}

fn field(message: &DynamicMessage, name: &str) -> Value {
    message.get_field_by_name(name).unwrap_or_else(|| panic!("no {name}")).into_owned()
}

fn inner(message: &DynamicMessage, name: &str) -> DynamicMessage {
    field(message, name).as_message().unwrap().clone()
}

fn text(message: &DynamicMessage, name: &str) -> String {
    field(message, name).as_str().unwrap().to_owned()
}

fn items(message: &DynamicMessage, name: &str) -> Vec<DynamicMessage> {
    let value = field(message, name);
    value.as_list().unwrap().iter().map(|item| item.as_message().unwrap().clone()).collect()
}

fn numbers<const N: usize>(message: &DynamicMessage, names: [&str; N]) -> [f64; N] {
    names.map(|name| field(message, name).as_f64().unwrap())
}

fn isometry(translation: &DynamicMessage, rotation: &DynamicMessage) -> Isometry3<f64> {
    let [x, y, z] = numbers(translation, ["x", "y", "z"]);
    let [i, j, k, w] = numbers(rotation, ["x", "y", "z", "w"]);
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

/// Frames by name: parent and place in it.
fn frames(tf: &DynamicMessage) -> BTreeMap<String, (String, Isometry3<f64>)> {
    let frames = items(tf, "transforms").into_iter().map(|frame| {
        let place = isometry(&inner(&frame, "translation"), &inner(&frame, "rotation"));
        (text(&frame, "child_frame_id"), (text(&frame, "parent_frame_id"), place))
    });
    frames.collect()
}

/// Where a frame is in the world.
fn in_world(frames: &BTreeMap<String, (String, Isometry3<f64>)>, name: &str) -> Isometry3<f64> {
    let mut place = Isometry3::identity();
    let mut name = name.to_owned();
    while name != "world" {
        let (parent, here) = &frames[&name];
        place = here * place;
        name.clone_from(parent);
    }
    place
}

fn truth(release_ns: u64, beta: MorphAngle) -> Truth {
    let q = UnitQuaternion::from_euler_angles(0.2, -0.1, 1.3);
    Truth {
        header: header(release_ns),
        position_w_m: [1.0, -2.0, 3.0],
        q_wb: Quaternion { w: q.w, x: q.i, y: q.j, z: q.k },
        morph_angle_rad: beta.rad(),
        ..Truth::default()
    }
}

#[test]
fn arms_end_where_the_vehicles_law_has_its_rotors_and_fold() {
    let rigid = vehicle::Quadratic::constant(0.12);
    let laws = [Geometry::default(), Geometry { arm_length_m: rigid, ..Geometry::default() }];
    for geometry in laws {
        let mut bends = Vec::new();
        for degrees in [45.0, 60.0, 94.5, 130.0, 160.0] {
            let beta = MorphAngle::from_degrees(degrees).unwrap();
            let vehicle = VehicleParameters { geometry, ..VehicleParameters::default() };
            let shown = shown(&mut Scene::of(&vehicle), &truth(0, beta));
            let frames = frames(&shown["/tf"]);
            let vehicle_shapes = items(&shown["/scene/vehicle"], "entities");
            let link = vehicle_shapes.iter().find(|e| text(e, "id") == "forearm_1").unwrap();
            let link = &items(link, "cubes")[0];
            let [link_m] = numbers(&inner(link, "size"), ["x"]);
            let body = in_world(&frames, "vehicle");
            assert!((body.translation.vector - Vector3::new(1.0, -2.0, 3.0)).norm() < 1e-12);
            for i in 0..4 {
                let direction_rad = FRAC_PI_2 * f64::from(i);
                let expected = body
                    * nalgebra::Point3::new(
                        libm::cos(direction_rad),
                        libm::sin(direction_rad),
                        0.0,
                    )
                    .map(|v| v * geometry.arm_length_m(beta));
                let rotor = in_world(&frames, &format!("rotor_{}", i + 1));
                assert!((rotor.translation.vector - expected.coords).norm() < 1e-12);
                let forearm = in_world(&frames, &format!("forearm_{}", i + 1));
                let end = forearm * nalgebra::Point3::new(link_m, 0.0, 0.0);
                assert!((end - expected).norm() < 1e-12, "the arm ends elsewhere: {end}");
            }
            bends.push(frames["forearm_1"].1.rotation.angle());
        }
        let folds = bends.windows(2).all(|pair| pair[0] > pair[1] + 0.1);
        assert_eq!(folds, geometry == Geometry::default(), "{bends:?}");
    }
}

#[test]
fn arrows_point_where_forces_do_and_are_as_long_as_they_are_strong() {
    let mut scene = Scene::of(&VehicleParameters::default());
    let forces = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.3, -0.4], [-0.1, -0.2, 0.3]];
    for (step, force_w_n) in (0_u64..).zip(forces) {
        let header = header(step * 20_000_000);
        let sample = Disturbance { header, force_w_n, ..Disturbance::default() };
        let shown = shown(&mut scene, &sample);
        let entities = items(&shown["/scene/disturbance"], "entities");
        assert_eq!(text(&entities[0], "frame_id"), "vehicle_level");
        let arrow = &items(&entities[0], "arrows")[0];
        let pose = inner(arrow, "pose");
        let place = isometry(&inner(&pose, "position"), &inner(&pose, "orientation"));
        let force = Vector3::from(force_w_n);
        assert!((place.rotation * Vector3::x() - force.normalize()).norm() < 1e-12);
        let length_m: f64 = numbers(arrow, ["shaft_length", "head_length"]).iter().sum();
        assert!((length_m - force.norm() / (0.12 * 9.81)).abs() < 1e-12);
        assert!(items(&entities[1], "arrows").is_empty(), "no wind, no arrow");
    }
    let rotor_thrust_n = [0.3, 0.0, 0.15, 1.0];
    let shown = shown(
        &mut scene,
        &ActuatorState { header: header(0), rotor_thrust_n, ..ActuatorState::default() },
    );
    let rotors = items(&shown["/scene/thrust"], "entities");
    let lengths: Vec<f64> = rotors
        .iter()
        .map(|rotor| {
            let arrows = items(rotor, "arrows");
            arrows.iter().flat_map(|a| numbers(a, ["shaft_length", "head_length"])).sum()
        })
        .collect();
    assert!((lengths[0] / lengths[2] - 2.0).abs() < 1e-12 && lengths[1] < 1e-12, "{lengths:?}");
    assert_eq!(text(&rotors[3], "frame_id"), "rotor_4");
}

/// Places \[m\] and colours of a cloud's points.
fn points(cloud: &DynamicMessage) -> Vec<([f64; 3], [u8; 4])> {
    let data = field(cloud, "data").as_bytes().unwrap().clone();
    let stride = usize::try_from(field(cloud, "point_stride").as_u32().unwrap()).unwrap();
    let offsets: Vec<usize> = items(cloud, "fields")
        .iter()
        .map(|f| usize::try_from(field(f, "offset").as_u32().unwrap()).unwrap())
        .collect();
    assert_eq!((data.len() % stride, offsets.len()), (0, 7));
    let point = |bytes: &[u8]| {
        let place = |i: usize| {
            let at = offsets[i];
            f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
        };
        ([place(0), place(1), place(2)], core::array::from_fn(|i| bytes[offsets[3 + i]]))
    };
    data.chunks(stride).map(point).collect()
}

#[test]
fn a_cloud_has_its_rotors_where_the_frames_have_them_and_its_path_where_it_was() {
    let mut scene = Scene::of(&VehicleParameters::default());
    let mut reaches_m = Vec::new();
    for (second, degrees) in (0..).zip([45.0, 94.5, 160.0]) {
        let beta = MorphAngle::from_degrees(degrees).unwrap();
        let shown = shown(&mut scene, &truth(second * 1_000_000_000, beta));
        let cloud = &shown["/cloud/vehicle"];
        assert_eq!(text(cloud, "frame_id"), "vehicle");
        let points = points(cloud);
        // The front rotor alone is orange.
        let front: Vec<_> = points.iter().filter(|(_, [r, _, b, _])| r > b && *r > 200).collect();
        let sum: Vector3<f64> = front.iter().map(|(place, _)| Vector3::from(*place)).sum();
        let centre = sum / front.len() as f64;
        let expected_m = VehicleParameters::default().geometry.arm_length_m(beta);
        assert!((centre - Vector3::new(expected_m, 0.0, 0.0)).norm() < 1e-6, "{centre}");
        let reach_m = points.iter().map(|(place, _)| Vector3::from(*place).norm());
        reaches_m.push(reach_m.fold(0.0, f64::max) - expected_m);
        let flown = &shown["/cloud/flown"];
        assert_eq!(text(flown, "frame_id"), "world");
        let passed = self::points(flown);
        let here = |place: &[f64; 3]| Vector3::from(*place) == Vector3::new(1.0, -2.0, 3.0);
        assert!(passed.iter().all(|(place, _)| here(place)));
        assert_eq!(passed.len() as u64, second + 1);
    }
    assert!(reaches_m.iter().all(|radius_m| (radius_m - reaches_m[0]).abs() < 1e-6));
}

#[test]
fn a_message_comes_once_a_period_and_paths_grow_and_are_forgotten() {
    let mut scene = Scene::of(&VehicleParameters::default());
    let mut counts = BTreeMap::<&str, u64>::new();
    let mut longest = 0;
    for tick in 0..25_000_u64 {
        for (name, message) in shown(&mut scene, &truth(tick * 1_000_000, MorphAngle::MEDIUM)) {
            *counts.entry(name).or_default() += 1;
            if name == "/scene/flown" {
                let line = &items(&items(&message, "entities")[0], "lines")[0];
                longest = longest.max(items(line, "points").len());
            }
        }
    }
    for channel in CHANNELS.iter().filter(|channel| channel.from == "truth") {
        assert_eq!(counts[channel.name], 25_000_000_000 / channel.period_ns, "{}", channel.name);
    }
    assert_eq!(longest, 200);
    let mut reference = Reference { header: header(0), count: 3, ..Reference::default() };
    for (point, x) in reference.points.iter_mut().zip([1.0, 2.0, 3.0, 4.0]) {
        *point = ReferencePoint { position_w_m: [x, 0.0, 1.5], yaw_rad: 1.0, ..*point };
    }
    let shown = shown(&mut scene, &reference);
    let lines = items(&shown["/scene/reference"], "entities");
    assert_eq!(items(&items(&lines[1], "lines")[0], "points").len(), 3);
    let pose = inner(&shown["/pose/reference"], "pose");
    let [z, w] = numbers(&inner(&pose, "orientation"), ["z", "w"]);
    assert!((2.0 * libm::atan2(z, w) - 1.0).abs() < 1e-12);
    let stamp = inner(&shown["/pose/reference"], "timestamp");
    assert_eq!(field(&stamp, "seconds").as_i64(), Some(1_700_000_000));
    assert_eq!(field(&stamp, "nanos").as_i32(), Some(250_000_000));
}

#[test]
fn every_channel_is_derived_from_a_topic_and_has_a_place_of_its_own() {
    for (i, channel) in CHANNELS.iter().enumerate() {
        assert!(topics::all().iter().any(|topic| topic.name == channel.from), "{}", channel.from);
        assert!(CHANNELS[..i].iter().all(|other| other.name != channel.name));
        assert!((channel.schema)().unwrap().name.starts_with("foxglove."));
    }
}

/// Fields of every topic, by the name of the topic with a slash.
fn schemas() -> BTreeMap<String, Schema> {
    struct All(BTreeMap<String, Schema>);
    impl TopicVisitor for All {
        type Error = core::convert::Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error> {
            self.0.insert(format!("/{}", topic.info.name), topic.schema());
            Ok(())
        }
    }
    let mut all = All(BTreeMap::new());
    topics::visit_all(&mut all).unwrap();
    all.0
}

#[test]
fn the_layout_for_plotjuggler_asks_only_for_what_a_recording_has_and_names_it() {
    let layout = plotjuggler_layout("/tmp/a & b/<x>.mcap");
    assert!(layout.contains("filename=\"/tmp/a &amp; b/&lt;x&gt;.mcap\""), "{layout}");
    let quoted = |text: &str, key: &str| -> Vec<String> {
        let key = format!(" {key}=\"");
        let parts = text.split(key.as_str()).skip(1);
        parts.filter_map(|part| part.split('"').next()).map(str::to_owned).collect()
    };
    let selected = quoted(&layout, "selected_topics").concat();
    let schemas = schemas();
    for topic in selected.split(';') {
        assert!(schemas.contains_key(topic) || topic == "/events", "{topic}");
    }
    let curves = ["name", "curve_x", "curve_y"].map(|key| quoted(&layout, key));
    let paths: Vec<_> = curves.into_iter().flatten().filter(|name| name.starts_with('/')).collect();
    assert!(paths.len() > 15, "{paths:?}");
    for path in paths {
        // Its separators are slashes, and ours dots behind the topic.
        let (topic, fields) = path[1..].split_once('/').unwrap();
        let path = format!("/{topic}.{}", fields.replace('/', "."));
        assert!(misled(&path, &schemas).is_none(), "{path}");
        assert!(selected.split(';').any(|known| known == format!("/{topic}")), "{path}");
    }
}

/// Why a path of the layout, such as `/truth.position_w_m[2]`, leads nowhere.
fn misled(path: &str, schemas: &BTreeMap<String, Schema>) -> Option<String> {
    let (topic, fields) = path.split_once('.')?;
    let Some(mut schema) = schemas.get(topic) else { return Some(format!("no topic {topic}")) };
    let nothing = |field: &str| Some(format!("{topic} has no {field}"));
    for field in fields.trim_end_matches(".@degrees").split('.') {
        let name = field.split(['[', '{']).next().unwrap_or_default();
        let Some(found) = schema.fields.iter().find(|f| f.name == name) else {
            return nothing(field);
        };
        if let Some(index) = field.split(['[', ']']).nth(1)
            && index.parse().is_ok_and(|index: usize| index >= found.count)
        {
            return nothing(field);
        }
        if let Kind::Message(nested) = found.kind {
            schema = nested;
        }
    }
    None
}

#[test]
fn the_layout_asks_only_for_what_a_recording_has() {
    fn paths(value: &serde_json::Value, found: &mut Vec<String>) {
        match value {
            serde_json::Value::Object(map) => {
                for key in ["value", "path", "topicPath"] {
                    if let Some(serde_json::Value::String(path)) = map.get(key) {
                        found.push(path.clone());
                    }
                }
                map.values().for_each(|value| paths(value, found));
            }
            serde_json::Value::Array(list) => list.iter().for_each(|value| paths(value, found)),
            _ => {}
        }
    }
    let layout: serde_json::Value = serde_json::from_str(LAYOUT).unwrap();
    let mut found = Vec::new();
    paths(&layout["configById"], &mut found);
    found.retain(|path| path.starts_with('/'));
    assert!(found.len() > 15, "{found:?}");
    let schemas = schemas();
    for path in &found {
        assert!(path.contains('.') && misled(path, &schemas).is_none(), "{path}");
    }
    let three_d = layout["configById"]["3D!flight"]["topics"].as_object().unwrap();
    for topic in three_d.keys() {
        assert!(CHANNELS.iter().any(|channel| channel.name == topic), "{topic}");
    }
    // Every panel has its place, and every place a panel.
    let mut placed = layout["layout"].to_string();
    for panel in layout["configById"].as_object().unwrap().keys() {
        assert!(placed.contains(&format!("\"{panel}\"")), "{panel}");
        placed = placed.replacen(panel, "", 1);
    }
    assert!(!placed.contains('!'), "{placed}");
}
