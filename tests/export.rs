//! `dynid export`, through the binary: a fitted model into its URDF and MJCF, as C and as JSON.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use insta::assert_snapshot;
use serde_json::Value;
use tempfile::TempDir;

/// Values of a model that a fit may have found.
const MODEL: &str = "device = \"arm.toml\"\n\n[link.1]\nm = 1.3\nIzz = 0.016\n\n[link.2]\nm = 0.95\nx = 0.2\n\n\
    [[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.21\n\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.06\n\n\
    [[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.25\n\n[[effect]]\nid = \"gain\"\njoint = 0\nKp = 1.07\n\n\
    [fit]\nerror = \"torque\"\nstatus = \"converged\"\ndata_digest = \"1\"\nparent_digest = \"2\"\ncost_after = 1.0\n\
    not_identifiable = [\"link.1.m\"]\n[fit.std_error]\n\"link.2.m\" = 0.004\n\"joint.1.coulomb.Fc\" = 0.002\n";

/// The arm's description, its device and a model of it.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    put(&folder, "arm.urdf", include_str!("own_robot/arm.urdf"));
    put(&folder, "model.toml", MODEL);
    dynid(&folder, &["device", "import", "arm.urdf", "--out", "arm.toml"]);
    folder
}

fn put(folder: &TempDir, name: &str, text: &str) {
    fs::write(folder.path().join(name), text).unwrap();
}

fn text(folder: &TempDir, name: &str) -> String {
    fs::read_to_string(folder.path().join(name)).unwrap()
}

fn dynid(folder: &TempDir, arguments: &[&str]) -> String {
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder.path()).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn refused(folder: &TempDir, arguments: &[&str]) -> String {
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

/// Lines of `new` that `old` does not have.
fn changed_lines(old: &str, new: &str) -> String {
    assert_eq!(old.lines().count(), new.lines().count());
    let changed = old.lines().zip(new.lines()).filter(|(old, new)| old != new).map(|(_, new)| new.trim());
    changed.collect::<Vec<_>>().join("\n")
}

#[test]
fn a_urdf_has_the_models_values_and_its_own_text() {
    let folder = folder();
    let export = ["export", "model.toml", "--as", "urdf", "--from", "arm.urdf", "--out", "identified.urdf"];
    assert_snapshot!(dynid(&folder, &export), @"
      `gain` at joint 0 has no place in a URDF: Kp = 1.07
      values that the logs determined only together with others, not each by itself: 1 (`not alone` in `dynid table`)
    written: identified.urdf
    ");
    assert_snapshot!(changed_lines(&text(&folder, "arm.urdf"), &text(&folder, "identified.urdf")), @r#"
    <dynamics damping="0.21"/>
    <mass value="1.3"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.014" iyz="0" izz="0.016"/>
    <dynamics damping="0.06" friction="0.25"/>
    <origin xyz="0.17866666666666667 0.019 0" rpy="0 0 0.1"/>
    <mass value="0.75"/>
    <inertia ixx="0.0010391585119156638" ixy="0.000244379031137602" ixz="0" iyy="0.0072825081547510054" iyz="0" izz="0.007321666666666665"/>
    "#);
    assert!(refused(&folder, &export).contains("identified.urdf exists already and is kept"));
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    let said = dynid(&folder, &[&export[..], &["--force"]].concat());
    let changed = changed_lines(&text(&folder, "arm.urdf"), &text(&folder, "identified.urdf"));
    for shown in [said.trim_end(), &changed] {
        assert!(readme.contains(shown), "the README shows something else than\n{shown}");
    }

    // What is imported again has the model's values.
    dynid(&folder, &["device", "import", "identified.urdf", "--out", "again.toml"]);
    put(&folder, "again_model.toml", "device = \"again.toml\"\n");
    let json =
        |model: &str| serde_json::from_str::<Value>(&dynid(&folder, &["export", model, "--as", "json"])).unwrap();
    let (own, again) = (json("model.toml"), json("again_model.toml"));
    let numbers = |link: &Value| -> Vec<f64> {
        let keys = ["first_moment_kg_m", "inertia_about_origin_kg_m2"];
        let flat = keys.iter().flat_map(|key| link[key].as_array().unwrap().iter().flat_map(flattened));
        flat.chain(link["mass_kg"].as_f64()).collect()
    };
    for link in 0..2 {
        let [own, again] = [&own, &again].map(|json| numbers(&json["links"][link]));
        for (own, again) in own.iter().zip(&again) {
            assert!((own - again).abs() < 1e-14, "{own} {again}");
        }
    }
}

fn flattened(value: &Value) -> Vec<f64> {
    value.as_array().map_or_else(|| vec![value.as_f64().unwrap()], |own| own.iter().flat_map(flattened).collect())
}

#[test]
fn an_mjcf_has_rotors_and_springs() {
    let folder = TempDir::new().unwrap();
    let arm = "<mujoco model=\"pendulum\">\n  <worldbody>\n    <body name=\"rod\">\n      \
        <joint name=\"hinge\" axis=\"0 1 0\"/>\n      <inertial pos=\"0 0 -0.3\" mass=\"1.0\" diaginertia=\"0.03 0.03 0.004\"/>\n    \
        </body>\n  </worldbody>\n</mujoco>\n";
    put(&folder, "rod.xml", arm);
    dynid(&folder, &["device", "import", "rod.xml", "--out", "rod.toml"]);
    let model = "device = \"rod.toml\"\n[link.1]\nm = 1.1\nIxy = 0.002\n[[effect]]\nid = \"rotor_inertia\"\njoint = 0\nIa = 0.02\n\
        [[effect]]\nid = \"spring\"\njoint = 0\nKs = 0.4\nqeq = 0.5\n";
    put(&folder, "model.toml", model);
    let export = ["export", "model.toml", "--as", "mjcf", "--from", "rod.xml", "--out", "identified.xml", "--json"];
    let json: Value = serde_json::from_str(&dynid(&folder, &export)).unwrap();
    assert_eq!(json["notes"].as_array().map(Vec::len), Some(0), "{json}");
    assert_snapshot!(changed_lines(arm, &text(&folder, "identified.xml")), @r#"
    <joint name="hinge" axis="0 1 0" stiffness="0.4" springref="28.64788975654116" armature="0.02"/>
    <inertial pos="0 0 -0.3" mass="1.1" fullinertia="0.03 0.03 0.004 0.002 0 0"/>
    "#);
}

#[test]
fn json_has_values_units_and_errors() {
    let folder = folder();
    let json: Value = serde_json::from_str(&dynid(&folder, &["export", "model.toml", "--as", "json"])).unwrap();
    let link = &json["links"][1];
    assert_eq!((link["name"].as_str(), link["frame"].as_str()), (Some("forearm"), Some("forearm")));
    assert_eq!((link["mass_kg"].as_f64(), link["std_error"]["m"].as_f64()), (Some(0.95), Some(0.004)));
    assert!(link["std_error"]["x"].is_null());
    // Steiner: Iyy about the origin = Iyy + m (x^2 + z^2).
    let number = |value: &Value| value.as_f64().unwrap();
    let [x, z] = [0, 2].map(|axis| number(&link["centroid_m"][axis]));
    let expected = number(&link["inertia_about_centroid_kg_m2"][1][1]) + 0.95 * (x * x + z * z);
    assert!((number(&link["inertia_about_origin_kg_m2"][1][1]) - expected).abs() < 1e-15);
    let coulomb = &json["effects"][2];
    assert_eq!((coulomb["effect"].as_str(), coulomb["joint"].as_u64()), (Some("coulomb"), Some(1)));
    let parameter = &coulomb["parameters"][0];
    assert_eq!((parameter["name"].as_str(), parameter["unit"].as_str()), (Some("joint.1.coulomb.Fc"), Some("N*m")));
    assert_eq!((parameter["value"].as_f64(), parameter["std_error"].as_f64()), (Some(0.25), Some(0.002)));
    assert_eq!(json["links"][0]["not_identifiable"][0], "link.1.m");
    assert_eq!(json["gravity_m_s2"].as_array().map(|own| number(&own[2])), Some(-9.81));

    // In a file it is the same.
    dynid(&folder, &["export", "model.toml", "--as", "json", "--out", "model.json"]);
    assert_eq!(serde_json::from_str::<Value>(&text(&folder, "model.json")).unwrap(), json);
}

/// A controller's author compiles the file as it is and calls it; what comes out is a torque known by hand.
#[test]
fn c_is_compiled_and_called() {
    let folder = TempDir::new().unwrap();
    put(&folder, "model.toml", "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.5\n");
    dynid(&folder, &["export", "model.toml", "--as", "c", "--free", "1", "--posture", "0.4,0", "--out", "arm.c"]);
    let program = "#include <stdio.h>\n#define PLANAR2R_DECLARATIONS_ONLY\n#include \"arm.c\"\nint main(void)\n{\n    \
        double prepared[PLANAR2R_N_PREPARED], still[1], moving[1];\n    const double q[1] = {0.3}, dq[1] = {2.0}, zero[1] = {0.0};\n    \
        planar2r_prepare_model(prepared);\n    \
        planar2r_model_torque(prepared, 0.0, q, zero, zero, planar2r_initial_states, zero, still);\n    \
        planar2r_model_torque(prepared, 0.0, q, dq, zero, planar2r_initial_states, zero, moving);\n    \
        printf(\"%.17g\\n\", moving[0] - still[0]);\n    return 0;\n}\n";
    put(&folder, "main.c", program);
    if !std::process::Command::new("cc").arg("--version").output().is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: there is no C compiler `cc`");
        return;
    }
    let build = ["-std=c99", "-O2", "main.c", "arm.c", "-o", "main", "-lm"];
    assert!(std::process::Command::new("cc").args(build).current_dir(folder.path()).status().unwrap().success());
    let output = std::process::Command::new(folder.path().join("main")).output().unwrap();
    // The other joint stands still, so that nothing depends on the speed but the friction.
    let friction: f64 = String::from_utf8(output.stdout).unwrap().trim().parse().unwrap();
    assert!((friction - 1.0).abs() < 1e-12, "{friction}");
}

#[test]
fn what_is_wrong_is_said() {
    let folder = folder();
    put(&folder, "other.urdf", &text(&folder, "arm.urdf").replace("name=\"elbow\"", "name=\"wrist\""));
    put(&folder, "model2.toml", "device = \"planar2r\"\n");
    let out = ["--out", "new.urdf"];
    let said = |arguments: &[&str]| refused(&folder, arguments);
    let urdf = ["export", "model.toml", "--as", "urdf"];
    assert_snapshot!(said(&[&urdf[..], &out, &["--from", "other.urdf"]].concat()), @r#"
    error: joint 1 is `wrist` here, and `elbow` in the model's device `arm`
      --> other.urdf:20:3
       |
    20 |   <joint name="wrist" type="revolute">
       |   ^^^^^^
       = help: name the file that `dynid device import` made the model's device from, or import this one and fit anew
    "#);
    assert_snapshot!(said(&[&urdf[..], &out].concat()), @"error: --from is missing: name the URDF or MJCF that the model's device was imported from");
    assert_snapshot!(said(&[&urdf[..], &out, &["--from", "nowhere.urdf"]].concat()), @"error: cannot read nowhere.urdf: No such file or directory (os error 2)");
    assert_snapshot!(said(&[&urdf[..], &["--from", "arm.urdf", "--out", "arm.urdf", "--force"]].concat()), @"error: --out arm.urdf: this is the file of --from, which stays as it is; choose another name");
    assert_snapshot!(said(&["export", "model.toml", "--as", "mjcf", "--from", "arm.urdf", "--out", "new.xml"]), @"error: arm.urdf: this is no MJCF; write it with `--as urdf`, or name a description of the format that you want");
    assert_snapshot!(said(&["export", "model2.toml", "--as", "urdf", "--from", "arm.urdf", "--out", "new.urdf"]), @r#"
    error: the model's device `planar2r` has no frame `upper_arm`
      --> arm.urdf:13:3
       |
    13 |   <link name="upper_arm">
       |   ^^^^^
       = help: name the file that `dynid device import` made the model's device from, or import this one and fit anew
    "#);
    assert_snapshot!(said(&["export", "model.toml", "--as", "c"]), @"error: --out is missing: name the file to write");
    assert_snapshot!(said(&["export", "model.toml", "--as", "c", "--free", "0,7", "--out", "arm.c"]), @"error: device `arm` has no free joints [0, 7]; name each once, from 0 to 1");
    assert_snapshot!(said(&["export", "model.toml", "--as", "c", "--posture", "0", "--out", "arm.c"]), @"error: --posture: 1 positions given, the device has 2 joints; give one for each");
    assert_snapshot!(said(&["export", "model.toml", "--as", "json", "--free", "0"]), @"error: --free and --posture are for `--as c`: the other formats have all joints; leave them out");
    assert!(!Path::new(&folder.path().join("new.urdf")).exists() && !folder.path().join("arm.c").exists());
}
