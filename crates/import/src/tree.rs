//! From links and joints to a tree that grows out of one link.

use std::collections::HashMap;

use dynid_model::{ModelError, Source, did_you_mean};

use crate::urdf::Robot;

/// Links of a description, those without mass included.
const MOST_LINKS: usize = 4096;

/// Who carries whom.
#[derive(Debug)]
pub(crate) struct Tree {
    /// Links by index, each after the one that carries it, the branches of a link one after another.
    pub order: Vec<usize>,
    /// The joint that carries each link; none for the root.
    pub joint_of: Vec<Option<usize>>,
    /// The link that carries each joint.
    pub parent_of: Vec<usize>,
}

/// # Errors
/// Links that nobody declared, a link that is carried twice, several roots, or none.
pub(crate) fn grow(source: &Source, robot: &Robot) -> Result<Tree, ModelError> {
    if robot.links.len() > MOST_LINKS {
        let message = format!("{} links, more than {MOST_LINKS}", robot.links.len());
        return Err(source
            .error(robot.links[MOST_LINKS].place.clone(), message)
            .help("leave out what does not move the robot"));
    }
    let index: HashMap<&str, usize> = (0..).zip(&robot.links).map(|(at, link)| (link.name.as_str(), at)).collect();
    let find = |(name, place): &(String, std::ops::Range<usize>), what: &str| {
        index.get(name.as_str()).copied().ok_or_else(|| {
            let known = did_you_mean(name, robot.links.iter().map(|link| link.name.as_str()));
            source.error(place.clone(), format!("unknown {what} link `{name}`")).help(known)
        })
    };
    let mut joint_of: Vec<Option<usize>> = vec![None; robot.links.len()];
    let mut parent_of = Vec::new();
    let mut carried: Vec<Vec<usize>> = vec![Vec::new(); robot.links.len()];
    for (number, joint) in robot.joints.iter().enumerate() {
        let (parent, child) = (find(&joint.parent, "parent")?, find(&joint.child, "child")?);
        if let Some(earlier) = joint_of[child] {
            let message = format!(
                "link `{}` is the child of two joints, `{}` and `{}`: a loop",
                joint.child.0, robot.joints[earlier].name, joint.name
            );
            return Err(source
                .error(joint.child.1.clone(), message)
                .help("a device is a tree; leave out the joint that closes the loop"));
        }
        joint_of[child] = Some(number);
        parent_of.push(parent);
        carried[parent].push(child);
    }
    let roots: Vec<usize> = (0..robot.links.len()).filter(|link| joint_of[*link].is_none()).collect();
    if let [first, second, ..] = roots[..] {
        let (first, second) = (&robot.links[first], &robot.links[second]);
        return Err(source
            .error(second.place.clone(), format!("no joint carries link `{}`, nor link `{}`", second.name, first.name))
            .help("one link stands still and carries all others; add a joint, `fixed` if it does not move"));
    }
    let mut order = Vec::new();
    let mut waiting = roots;
    while let Some(link) = waiting.pop() {
        order.push(link);
        waiting.extend(carried[link].iter().rev());
    }
    if let Some(lost) = (0..robot.links.len()).find(|link| !order.contains(link)) {
        // Each of these is carried by another of them.
        let joint = &robot.joints[joint_of[lost].unwrap_or_default()];
        let message = format!("link `{}` is carried, through others, by itself: a loop", robot.links[lost].name);
        return Err(source
            .error(joint.place.clone(), message)
            .help("one link stands still and carries all others; turn one of the joints around"));
    }
    Ok(Tree { order, joint_of, parent_of })
}
