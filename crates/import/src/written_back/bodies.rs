//! Masses, centroids and inertias, back to the links that they came from.

use dynid_model::physical_consistency::check_body;
use nalgebra::{Matrix3, Vector3};
use roxmltree::Node;

use super::{Description, Identified};
use crate::{
    Format,
    body::Body,
    pose::{Pose, without_rounding},
    urdf::Inertial,
    xml::child,
};

/// Frames whose body is the description's own keep their text. An inertia that no body has was mended by the import: the mended one
/// takes its place.
pub(super) fn write(description: &mut Description, identified: &Identified) {
    let draft = description.draft;
    for (frame, own) in draft.frames.iter().enumerate() {
        let body = identified.bodies.get(&own.name).copied().unwrap_or([0.0; 10]);
        let imported = draft.links.iter().find(|link| link.frame == frame);
        let values = imported.map_or([0.0; 10], |link| link.inertial.each_ref().map(|number| number.value));
        let is_mended = Body::merged(&stated_bodies(description, frame)).mended().is_some();
        if let Some(link) = imported.filter(|_| is_mended && body == values) {
            description.notes.push(format!(
                "no body has the inertia that the description states of link `{}`; it has the device's now, which the import mended",
                link.title
            ));
        }
        if is_mended || body != values {
            write_frame(description, frame, &Body::from_values(&body));
        }
    }
}

/// The bodies of the links that move with a frame, in the frame's axes.
fn stated_bodies(description: &Description, frame: usize) -> Vec<Body> {
    let Description { robot, seats, .. } = *description;
    let here = (0..robot.links.len()).filter(|link| seats[*link].frame == Some(frame));
    let inertials = here.filter_map(|link| Some((link, robot.links[link].inertial.as_ref()?)));
    inertials.map(|(link, inertial)| Body::of(inertial).seen_from(&seats[link].pose)).collect()
}

/// Divides a body among the links that move with a frame.
fn write_frame(description: &mut Description, frame: usize, body: &Body) {
    let Description { robot, tree, seats, .. } = *description;
    let here: Vec<usize> = tree.order.iter().copied().filter(|link| seats[*link].frame == Some(frame)).collect();
    let stated = |link: usize| robot.links[link].inertial.as_ref().map(Body::of).filter(|body| !body.is_nothing());
    let with_mass: Vec<usize> = here.iter().copied().filter(|link| stated(*link).is_some()).collect();
    let Some(&carrier) = with_mass.first().or(here.first()) else { return };
    let others = &with_mass[with_mass.len().min(1)..];
    let bodies: Vec<Body> =
        others.iter().filter_map(|link| Some(stated(*link)?.seen_from(&seats[*link].pose))).collect();
    let rest = body.without(&bodies);
    if rest.is_none() {
        let name = |link: &usize| format!("`{}`", robot.links[*link].name);
        let of_others: Vec<String> = others.iter().map(name).collect();
        description.notes.push(format!(
            "link {} carries the mass of {} too, which have none now: no body is what the sum leaves beside what they stated",
            name(&carrier),
            of_others.join(", ")
        ));
        others.iter().for_each(|link| write_nothing(description, *link));
    }
    let own = rest.unwrap_or_else(|| body.clone()).seen_from(&seats[carrier].pose.inverse());
    write_body(description, carrier, &own);
}

fn write_body(description: &mut Description, link: usize, body: &Body) {
    let link = &description.robot.links[link];
    let Some(element) = description.element_at(&link.place) else { return };
    match (child(element, "inertial"), &link.inertial, description.format) {
        (Some(node), Some(inertial), Format::Urdf) => write_urdf(description, node, inertial, body),
        (Some(node), Some(inertial), Format::Mjcf) => write_mjcf(description, node, inertial, body),
        (_, _, format) => description.edits.add_child(element, &new_inertial(format, body)),
    }
}

/// Takes a link's mass away. Without an `<inertial>`, some readers of both formats would take a mass from shapes.
fn write_nothing(description: &mut Description, link: usize) {
    let element = description.element_at(&description.robot.links[link].place);
    let Some(node) = element.and_then(|element| child(element, "inertial")) else { return };
    match description.format {
        Format::Urdf => {
            child(node, "mass").iter().for_each(|mass| description.edits.set_numbers(*mass, "value", &[0.0]));
            let inertia = child(node, "inertia");
            inertia.iter().for_each(|inertia| set_urdf_moments(description, *inertia, [0.0; 6]));
        }
        Format::Mjcf => {
            description.edits.set_numbers(node, "mass", &[0.0]);
            let key = if node.has_attribute("fullinertia") { "fullinertia" } else { "diaginertia" };
            description.edits.set_numbers(node, key, &[0.0; 6][..if key == "fullinertia" { 6 } else { 3 }]);
        }
    }
}

/// The axes in which the inertia is stated stay.
fn write_urdf(description: &mut Description, node: Node, inertial: &Inertial, body: &Body) {
    let edits = &mut description.edits;
    let place = coordinates(&body.centroid);
    match child(node, "origin") {
        Some(origin) => edits.set_numbers_or_default(origin, "xyz", &place, &[0.0; 3]),
        None if place == [0.0; 3] => {}
        None => edits.add_child(node, &format!("<origin xyz=\"{}\"/>", words(&place))),
    }
    if let Some(mass) = child(node, "mass") {
        edits.set_numbers(mass, "value", &[body.mass]);
    }
    if let Some(inertia) = child(node, "inertia") {
        set_urdf_moments(description, inertia, moments(&in_axes_of(body, inertial)));
    }
}

fn set_urdf_moments(description: &mut Description, inertia: Node, moments: [f64; 6]) {
    for (key, moment) in URDF_MOMENTS.into_iter().zip(moments) {
        description.edits.set_numbers(inertia, key, &[moment]);
    }
}

const URDF_MOMENTS: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// The axes in which the inertia is stated stay where they are principal ones still; else the inertia is stated in the body's.
fn write_mjcf(description: &mut Description, node: Node, inertial: &Inertial, body: &Body) {
    let edits = &mut description.edits;
    edits.set_numbers_or_default(node, "pos", &coordinates(&body.centroid), &[0.0; 3]);
    edits.set_numbers(node, "mass", &[body.mass]);
    let [xx, xy, xz, yy, yz, zz] = moments(&in_axes_of(body, inertial));
    if node.has_attribute("fullinertia") {
        edits.set_numbers(node, "fullinertia", &[xx, yy, zz, xy, xz, yz]);
    } else if [xy, xz, yz] == [0.0; 3] {
        edits.set_numbers(node, "diaginertia", &[xx, yy, zz]);
    } else {
        // MuJoCo takes no axes beside a full matrix.
        ["quat", "axisangle", "euler", "xyaxes", "zaxis"].iter().for_each(|key| edits.remove_attribute(node, key));
        let [xx, xy, xz, yy, yz, zz] = moments(&body.inertia);
        edits.rename(node, "diaginertia", "fullinertia", &[xx, yy, zz, xy, xz, yz]);
    }
}

fn new_inertial(format: Format, body: &Body) -> String {
    let ([x, y, z], [xx, xy, xz, yy, yz, zz]) = (coordinates(&body.centroid), moments(&body.inertia));
    let mass = words(&[body.mass]);
    match format {
        Format::Urdf => {
            let keys = URDF_MOMENTS.into_iter().zip([xx, xy, xz, yy, yz, zz]);
            let inertia: Vec<String> = keys.map(|(key, moment)| format!("{key}=\"{}\"", words(&[moment]))).collect();
            format!(
                "<inertial><origin xyz=\"{}\"/><mass value=\"{mass}\"/><inertia {}/></inertial>",
                words(&[x, y, z]),
                inertia.join(" ")
            )
        }
        Format::Mjcf => format!(
            "<inertial pos=\"{}\" mass=\"{mass}\" fullinertia=\"{}\"/>",
            words(&[x, y, z]),
            words(&[xx, yy, zz, xy, xz, yz])
        ),
    }
}

fn in_axes_of(body: &Body, inertial: &Inertial) -> Matrix3<f64> {
    let pose = inertial.origin.pose();
    if pose.is_turned() { pose.rotation.transpose() * body.inertia * pose.rotation } else { body.inertia }
}

fn coordinates(place: &Vector3<f64>) -> [f64; 3] {
    [0, 1, 2].map(|axis| without_rounding(place[axis]))
}

/// `Ixx Ixy Ixz Iyy Iyz Izz`; what a rotation leaves of a product that is zero is far below what any inertia is known to.
fn moments(inertia: &Matrix3<f64>) -> [f64; 6] {
    let [_, _, _, _, xx, xy, xz, yy, yz, zz] =
        Body { mass: 0.0, centroid: Vector3::zeros(), inertia: *inertia }.values();
    [xx, xy, xz, yy, yz, zz]
}

fn words(numbers: &[f64]) -> String {
    numbers.iter().map(|number| super::edits::written(*number)).collect::<Vec<_>>().join(" ")
}

impl Body {
    /// In the order of [`dynid_model::Link::SYMBOLS`].
    fn from_values(&[mass, x, y, z, xx, xy, xz, yy, yz, zz]: &[f64; 10]) -> Self {
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Self { mass, centroid: Vector3::new(x, y, z), inertia }
    }

    /// What is left without these; `None` where no body is like that.
    fn without(&self, others: &[Self]) -> Option<Self> {
        if others.is_empty() {
            return Some(self.clone());
        }
        let taken = Self::merged(others);
        let mass = self.mass - taken.mass;
        if mass <= 0.0 {
            return None;
        }
        let centroid = (self.mass * self.centroid - taken.mass * taken.centroid) / mass;
        let about_own = |body: &Self| {
            let arm = body.centroid - centroid;
            body.inertia + body.mass * (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose())
        };
        let rest = Self { mass, centroid, inertia: about_own(self) - about_own(&taken) };
        check_body(&rest.values()).ok().map(|()| rest)
    }
}

impl Pose {
    fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, place: -(rotation * self.place) }
    }
}
