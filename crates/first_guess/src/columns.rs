//! Which column is what, by its name; where a name leaves it open, by its numbers.
//!
//! Columns whose names differ in the joint alone are a group: the positions of all joints, the measured torques, the
//! references. A group is taken whole.

use dynid_logs::noise::moves;
use dynid_model::Device;

use crate::chosen::Chosen;
use crate::guess::{ColumnGuess, Factor, FactorReason, Remark, WhyColumn};
use crate::names::{JointKey, Meaning, Origin, Quantity, Unit, meaning, words};
use crate::table::Table;
use crate::{FirstGuessError, Known, Lacking, time};

/// Chooses the columns of the logs.
pub(crate) fn choose(device: &Device, tables: &[Table], known: &Known) -> Result<Chosen, FirstGuessError> {
    let header = Header::of(device, tables, known)?;
    let mut time = match header.said("t") {
        Some(place) => {
            time::refuse_words(tables, header.name(place))?;
            header.guess("t".to_owned(), place, WhyColumn::Said)
        }
        None => time::choose(tables, &header.meanings)?,
    };
    let groups = header.groups();
    let positions = header.positions(&groups)?;
    let of_positions = header.guesses("q", &positions);
    same_headers(tables, std::iter::once(&time).chain(&of_positions))?;
    let free = free_joints(tables, &header, &positions, known)?;
    let references = header.references(&groups, &positions, &free)?;
    let torques = header.torques(&groups, &positions, &references, &free)?;

    let time_unit = header.meanings[header.place(&time.name)].unit.filter(|unit| unit.quantity == Quantity::Time);
    if let (Some(unit), true) = (time_unit, time.factors.is_empty()) {
        time.factors.extend(in_name(unit));
    }
    let mut columns = vec![time];
    columns.extend(of_positions);
    columns.extend(header.guesses("tau", &torques.0));
    let mut remarks = Vec::new();
    match &references {
        Some((own, correlation)) => {
            columns.extend(header.guesses("ref", own));
            remarks.push(Remark::ClosedLoop { correlation: *correlation });
        }
        None => remarks.push(Remark::OpenLoop),
    }
    let ever = |joint: &usize| free.iter().any(|own| own.contains(joint));
    let never: Vec<usize> = (0..device.joints.len()).filter(|joint| !ever(joint)).collect();
    if !never.is_empty() {
        remarks.push(Remark::NeverMoves { joints: never });
    }
    remarks.extend(columns.iter().filter_map(|column| header.unit_of_other(column)));
    same_headers(tables, &columns)?;
    Ok(Chosen {
        is_time_unit_known: time_unit.is_some(),
        is_position_unit_known: positions
            .places
            .iter()
            .flatten()
            .any(|(place, _)| header.position_unit(*place).is_some()),
        not_commands: torques.1,
        speeds: header.speeds(&groups, positions.first),
        mask: header.mask(),
        columns,
        free,
        remarks,
    })
}

/// Names of the columns that are not used.
pub(crate) fn unused(table: &Table, chosen: &Chosen) -> Vec<String> {
    let used =
        |name: &String| chosen.columns.iter().any(|column| column.name == *name) || chosen.mask.as_ref() == Some(name);
    table.names.iter().filter(|name| !name.is_empty() && !used(name)).cloned().collect()
}

/// Columns whose names differ in the joint alone.
#[derive(Debug, Clone)]
struct Group {
    quantity: Option<Quantity>,
    origin: Origin,
    unknown: Vec<String>,
    members: Vec<(usize, JointKey)>,
}

/// The column of each joint.
#[derive(Debug, Clone)]
struct Assigned {
    places: Vec<Option<(usize, WhyColumn)>>,
    /// The number of joint 0 in the names, where they are numbered.
    first: Option<usize>,
    /// Other columns of the same quantity, by joint.
    others: Vec<Vec<usize>>,
}

struct Header<'a> {
    device: &'a Device,
    tables: &'a [Table],
    meanings: Vec<Meaning>,
    /// Logical name and place of what a person said.
    said: Vec<(String, usize)>,
}

impl<'a> Header<'a> {
    fn of(device: &'a Device, tables: &'a [Table], known: &Known) -> Result<Self, FirstGuessError> {
        let first = &tables[0];
        let meanings = first.names.iter().map(|name| meaning(name, device)).collect();
        let place = |(logical, name): &(String, String)| {
            let place = first.names.iter().position(|own| own == name);
            place.map(|place| (logical.clone(), place)).ok_or_else(|| FirstGuessError::NoSuchColumn {
                path: first.path.clone(),
                name: name.clone(),
                logical: logical.clone(),
                available: first.header(),
            })
        };
        let said = known.columns.iter().map(place).collect::<Result<_, _>>()?;
        Ok(Self { device, tables, meanings, said })
    }

    fn n_joints(&self) -> usize {
        self.device.joints.len()
    }

    fn name(&self, place: usize) -> &str {
        &self.tables[0].names[place]
    }

    fn place(&self, name: &str) -> usize {
        self.tables[0].names.iter().position(|own| own == name).unwrap_or(0)
    }

    fn said(&self, logical: &str) -> Option<usize> {
        self.said.iter().find(|(own, _)| own == logical).map(|(_, place)| *place)
    }

    /// Values of a column in every log.
    fn values(&self, place: usize) -> impl Iterator<Item = &[f64]> {
        self.tables.iter().filter_map(move |table| table.column(self.name(place)))
    }

    fn is_constant(&self, place: usize) -> bool {
        self.values(place).all(|values| values.windows(2).all(|pair| pair[0] == pair[1]))
    }

    fn groups(&self) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        for (place, own) in self.meanings.iter().enumerate() {
            if self.said.iter().any(|(_, said)| *said == place) || own.quantity == Some(Quantity::Time) {
                continue;
            }
            let alike = |group: &&mut Group| {
                (group.quantity, group.origin, &group.unknown) == (own.quantity, own.origin, &own.unknown)
            };
            match groups.iter_mut().find(alike) {
                Some(group) => group.members.push((place, own.joint)),
                None => groups.push(Group {
                    quantity: own.quantity,
                    origin: own.origin,
                    unknown: own.unknown.clone(),
                    members: vec![(place, own.joint)],
                }),
            }
        }
        groups
    }

    /// The columns of a group by joint; `first` is the number of joint 0 in other names.
    fn assigned(&self, group: &Group, first: Option<usize>) -> Assigned {
        let n = self.n_joints();
        let numbers: Vec<usize> = group
            .members
            .iter()
            .filter_map(|(_, joint)| if let JointKey::Number(number) = joint { Some(*number) } else { None })
            .collect();
        let least = numbers.iter().min().copied();
        let first = match least {
            None => None,
            Some(0) => Some(0),
            Some(_) if numbers.contains(&n) && n > 1 => Some(1),
            Some(least) => Some(first.unwrap_or(if numbers.len() == n { least } else { 1 })),
        };
        let mut own = Assigned { places: vec![None; n], first, others: vec![Vec::new(); n] };
        for (place, key) in &group.members {
            let found = match (key, first) {
                (JointKey::Title(joint), _) => {
                    Some((*joint, WhyColumn::Title { title: self.device.joints[*joint].title.clone() }))
                }
                (JointKey::Number(number), Some(first)) => {
                    number.checked_sub(first).map(|joint| (joint, WhyColumn::Number { number: *number, first }))
                }
                _ if n == 1 && group.members.len() == 1 => Some((0, WhyColumn::OnlyOne)),
                _ => None,
            };
            if let Some((joint, why)) = found.filter(|(joint, _)| *joint < n) {
                match own.places[joint] {
                    None => own.places[joint] = Some((*place, why)),
                    Some(_) => own.others[joint].push(*place),
                }
            }
        }
        own
    }

    /// Columns of the groups that say no joint, as many as there are joints: in their order. None is in a unit that its joint cannot have.
    fn in_order(&self, groups: &[&Group]) -> Option<Assigned> {
        let is_loose = |group: &&&Group| group.members.iter().all(|(_, joint)| *joint == JointKey::Unsaid);
        let loose: Vec<&Group> = groups.iter().filter(is_loose).copied().collect();
        let mut places: Vec<usize> =
            loose.iter().flat_map(|group| group.members.iter().map(|(place, _)| *place)).collect();
        places.sort_unstable();
        let may_be = |(joint, place): (usize, &usize)| {
            let unit = self.meanings[*place].unit.filter(|unit| unit.quantity == Quantity::Position);
            unit.is_none_or(|unit| unit.is_of_joint(self.device.joints[joint].kind))
        };
        let is_whole = places.len() == self.n_joints() && places.iter().enumerate().all(may_be);
        is_whole.then(|| Assigned {
            others: vec![Vec::new(); places.len()],
            places: places.into_iter().map(|place| Some((place, WhyColumn::Order))).collect(),
            first: None,
        })
    }

    /// The best of the groups that some joints need, with the others as what might be instead.
    fn best(
        &self,
        groups: &[&Group],
        first: Option<usize>,
        needed: &[usize],
        rank: impl Fn(&Group) -> usize,
    ) -> Option<Assigned> {
        let all: Vec<(&Group, Assigned)> = groups.iter().map(|group| (*group, self.assigned(group, first))).collect();
        let lacks = |own: &Assigned| needed.iter().filter(|joint| own.places[**joint].is_none()).count();
        let stands = |own: &Assigned| own.places.iter().flatten().all(|(place, _)| self.is_constant(*place));
        let key = |(group, own): &&(&Group, Assigned)| {
            (lacks(own), stands(own), rank(group), group.unknown.len(), group.origin == Origin::Commanded)
        };
        let in_order = || self.in_order(groups);
        let Some((group, mut best)) = all.iter().min_by_key(key).cloned() else { return in_order() };
        if lacks(&best) > 0
            && let Some(ordered) = in_order()
        {
            return Some(ordered);
        }
        for (joint, others) in best.others.iter_mut().enumerate() {
            let own = best.places[joint].as_ref().map(|(place, _)| *place);
            let as_clear = all.iter().filter(|(other, _)| other.unknown.len() <= group.unknown.len());
            let of_joint = as_clear.filter_map(|(_, other)| other.places[joint].as_ref().map(|(place, _)| *place));
            others.extend(of_joint.filter(|place| Some(*place) != own));
        }
        Some(best)
    }

    /// What a person said goes before what was found.
    fn with_said(&self, kind: &str, found: Option<Assigned>) -> Assigned {
        let n = self.n_joints();
        let none = Assigned { places: vec![None; n], first: None, others: vec![Vec::new(); n] };
        let mut own = found.unwrap_or(none);
        for joint in 0..n {
            if let Some(place) = self.said(&format!("{kind}{joint}")) {
                own.places[joint] = Some((place, WhyColumn::Said));
            }
        }
        own
    }

    fn positions(&self, groups: &[Group]) -> Result<Assigned, FirstGuessError> {
        let is_measured =
            |group: &&Group| group.quantity == Some(Quantity::Position) && group.origin != Origin::Commanded;
        let measured: Vec<&Group> = groups.iter().filter(is_measured).collect();
        let all: Vec<usize> = (0..self.n_joints()).collect();
        let own = self.with_said("q", self.best(&measured, None, &all, |_| 0));
        match own.places.iter().position(Option::is_none) {
            Some(joint) => Err(self.missing(Lacking::Position, joint)),
            None => Ok(own),
        }
    }

    /// References, and how well the positions follow them: the least correlation of a joint. Those that a person names are taken, whether
    /// or not they are followed.
    fn references(
        &self,
        groups: &[Group],
        positions: &Assigned,
        free: &[Vec<usize>],
    ) -> Result<Option<(Assigned, f64)>, FirstGuessError> {
        let joints = union(free);
        let is_said = |joint: &usize| self.said(&format!("ref{joint}")).is_some();
        let unsaid: Vec<usize> = joints.iter().copied().filter(|joint| !is_said(joint)).collect();
        let found = if unsaid.is_empty() { None } else { self.followed(groups, positions, &unsaid) };
        if !(0..self.n_joints()).any(|joint| is_said(&joint)) {
            return Ok(found);
        }
        let own = self.with_said("ref", found.map(|(own, _)| own));
        if let Some(&joint) = joints.iter().find(|joint| own.places[**joint].is_none()) {
            return Err(self.missing(Lacking::Reference, joint));
        }
        let correlations = joints.iter().filter_map(|&joint| self.following(&own, positions, joint));
        let least = correlations.map(|(correlation, _)| correlation).fold(1.0, f64::min);
        Ok(Some((own, least)))
    }

    /// The references that the positions follow best.
    fn followed(&self, groups: &[Group], positions: &Assigned, joints: &[usize]) -> Option<(Assigned, f64)> {
        /// Less than that is no following. A command that does not say of what must be nearer than a torque gets, which
        /// goes with the position as well where a spring or gravity holds the joint.
        const LEAST: f64 = 0.5;
        const NEAR: f64 = 0.6;
        let commanded = groups.iter().filter(|group| {
            group.origin == Origin::Commanded && matches!(group.quantity, None | Some(Quantity::Position))
        });
        let mut found: Vec<(Assigned, f64)> = Vec::new();
        for group in commanded {
            let mut own = self.assigned(group, positions.first);
            let of_joints = joints.iter().map(|&joint| self.following(&own, positions, joint));
            let Some(of_joints) = of_joints.collect::<Option<Vec<(f64, f64)>>>() else { continue };
            let correlation = of_joints.iter().map(|(correlation, _)| *correlation).fold(1.0, f64::min);
            let left = of_joints.iter().map(|(_, left)| *left).fold(0.0, f64::max);
            if correlation < LEAST || (group.quantity.is_none() && left > NEAR) {
                continue;
            }
            if group.quantity.is_none() {
                own.places.iter_mut().flatten().for_each(|(_, why)| *why = WhyColumn::IsFollowed);
            }
            found.push((own, correlation));
        }
        found.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Correlation of a joint's reference with its position, and the RMS of their difference over that of the motion.
    fn following(&self, references: &Assigned, positions: &Assigned, joint: usize) -> Option<(f64, f64)> {
        let (reference, position) = (references.places[joint].as_ref()?.0, positions.places[joint].as_ref()?.0);
        let factor = |place: usize| self.position_unit(place).map_or(1.0, |unit| unit.factor);
        let (to, from) = (factor(reference), factor(position));
        let (mut both, mut of_reference, mut of_position, mut left) = (0.0, 0.0, 0.0, 0.0);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        for (r, q) in self.values(reference).zip(self.values(position)) {
            let (r_mean, q_mean) = (mean(r), mean(q));
            for (r, q) in r.iter().zip(q) {
                let (r_off, q_off) = (to * (r - r_mean), from * (q - q_mean));
                both += r_off * q_off;
                of_reference += r_off * r_off;
                of_position += q_off * q_off;
                left += (r * to - q * from).powi(2);
            }
        }
        let correlation = both / (of_reference * of_position).sqrt();
        correlation.is_finite().then(|| (correlation, (left / of_position).sqrt()))
    }

    /// Torques, and what each joint's is where that is not the joint's command.
    fn torques(
        &self,
        groups: &[Group],
        positions: &Assigned,
        references: &Option<(Assigned, f64)>,
        free: &[Vec<usize>],
    ) -> Result<(Assigned, Vec<Option<Quantity>>), FirstGuessError> {
        use Quantity::{Current, Torque, Voltage};
        let command = |joint: usize| match self.device.joints[joint].command_unit.as_str() {
            "A" => Current,
            "V" => Voltage,
            _ => Torque,
        };
        let order = match command(0) {
            Current => [Current, Torque, Voltage],
            Voltage => [Voltage, Torque, Current],
            _ => [Torque, Current, Voltage],
        };
        let rank = |group: &Group| order.iter().position(|own| Some(*own) == group.quantity).unwrap_or(order.len());
        let follows = |group: &Group| {
            references.as_ref().is_some_and(|(own, _)| {
                own.places.iter().flatten().any(|(place, _)| group.members.iter().any(|(member, _)| member == place))
            })
        };
        let drives: Vec<&Group> = groups
            .iter()
            .filter(|group| {
                let is_bare = group.quantity.is_none() && group.origin == Origin::Commanded && !follows(group);
                rank(group) < order.len() || is_bare
            })
            .collect();
        let joints = union(free);
        let found = self.best(&drives, positions.first, &joints, rank);
        let mut own = self.with_said("tau", found);
        if let Some(&joint) = joints.iter().find(|joint| own.places[**joint].is_none()) {
            return Err(self.missing(Lacking::Torque, joint));
        }
        let is_bare =
            |place: usize, why: &WhyColumn| *why != WhyColumn::Said && self.meanings[place].quantity.is_none();
        let bare = own.places.iter_mut().flatten().filter(|(place, why)| is_bare(*place, why));
        bare.for_each(|(_, why)| *why = WhyColumn::IsNotFollowed);
        let not_commands = own.places.iter().enumerate().map(|(joint, place)| {
            let quantity = self.meanings[place.as_ref()?.0].quantity;
            quantity.filter(|own| matches!(own, Current | Voltage) && *own != command(joint))
        });
        let not_commands = not_commands.collect();
        Ok((own, not_commands))
    }

    fn missing(&self, lacking: Lacking, joint: usize) -> FirstGuessError {
        let (path, title) = (self.tables[0].path.clone(), self.device.joints[joint].title.clone());
        FirstGuessError::NoColumn { path, lacking, joint, title, available: self.tables[0].header() }
    }

    fn speeds(&self, groups: &[Group], first: Option<usize>) -> Vec<Option<(String, Option<f64>)>> {
        let is_speed = |group: &&Group| group.quantity == Some(Quantity::Speed) && group.origin != Origin::Commanded;
        let speeds: Vec<&Group> = groups.iter().filter(is_speed).collect();
        let all: Vec<usize> = (0..self.n_joints()).collect();
        let Some(own) = self.best(&speeds, first, &all, |_| 0) else { return vec![None; all.len()] };
        let of_place = |place: usize| (self.name(place).to_owned(), self.position_unit(place).map(|unit| unit.factor));
        own.places.iter().map(|place| place.as_ref().map(|(place, _)| of_place(*place))).collect()
    }

    /// The unit of angle or length that a name says.
    fn position_unit(&self, place: usize) -> Option<Unit> {
        self.meanings[place].unit.filter(|unit| unit.quantity == Quantity::Position)
    }

    /// Whether what a column is taken for may be in that unit.
    fn is_of(&self, unit: &Unit, column: &ColumnGuess) -> bool {
        match (column.kind(), column.joint()) {
            ("q" | "ref", Some(joint)) => unit.is_of_joint(self.device.joints[joint].kind),
            ("tau", _) => unit.quantity.drives(),
            _ => unit.quantity == Quantity::Time,
        }
    }

    fn unit_of_other(&self, column: &ColumnGuess) -> Option<Remark> {
        let unit = self.meanings[self.place(&column.name)].unit.filter(|unit| !self.is_of(unit, column))?;
        let (column, logical) = (column.name.clone(), column.logical.clone());
        Some(Remark::UnitOfOther { column, unit: unit.name, logical })
    }

    /// A column of zeros and ones whose name says that rows are used or not.
    fn mask(&self) -> Option<String> {
        const WORDS: [&str; 4] = ["use", "used", "valid", "mask"];
        let is_mask = |place: &usize| {
            let said = words(self.name(*place)).iter().any(|word| WORDS.contains(&word.as_str()));
            let is_binary = self.values(*place).all(|values| values.iter().all(|value| *value == 0.0 || *value == 1.0));
            said && is_binary && !self.is_constant(*place)
        };
        (0..self.meanings.len()).find(is_mask).map(|place| self.name(place).to_owned())
    }

    fn guesses(&self, kind: &str, own: &Assigned) -> Vec<ColumnGuess> {
        let joints = own.places.iter().zip(&own.others).enumerate();
        joints
            .filter_map(|(joint, (place, others))| {
                let (place, why) = place.clone()?;
                let mut guess = self.guess(format!("{kind}{joint}"), place, why);
                guess.others = others.iter().map(|place| self.name(*place).to_owned()).collect();
                let unit = self.meanings[place].unit.filter(|unit| self.is_of(unit, &guess));
                guess.factors.extend(unit.and_then(in_name));
                Some(guess)
            })
            .collect()
    }

    fn guess(&self, logical: String, place: usize, why: WhyColumn) -> ColumnGuess {
        let name = self.name(place).to_owned();
        let why = if why != WhyColumn::Said && name == logical { WhyColumn::OwnName } else { why };
        ColumnGuess { logical, name, why, others: Vec::new(), factors: Vec::new(), turn: None }
    }
}

/// The factor of a unit that a name says, unless that is SI.
fn in_name(unit: Unit) -> Option<Factor> {
    let reason = FactorReason::UnitInName { unit: unit.name };
    (unit.factor != 1.0).then_some(Factor { factor: unit.factor, reason })
}

/// Free joints of each log: what a person said, else those that move by more than their noise.
fn free_joints(
    tables: &[Table],
    header: &Header<'_>,
    positions: &Assigned,
    known: &Known,
) -> Result<Vec<Vec<usize>>, FirstGuessError> {
    let of_log = |table: &Table| {
        let does_move = |joint: &usize| {
            let place = positions.places[*joint].as_ref().map(|(place, _)| *place);
            place.and_then(|place| table.column(header.name(place))).is_some_and(moves)
        };
        let mut free = known.free.clone().unwrap_or_else(|| (0..header.n_joints()).filter(does_move).collect());
        free.sort_unstable();
        free.dedup();
        if free.is_empty() { Err(FirstGuessError::NothingMoves { path: table.path.clone() }) } else { Ok(free) }
    };
    tables.iter().map(of_log).collect()
}

fn union(free: &[Vec<usize>]) -> Vec<usize> {
    let mut all: Vec<usize> = free.concat();
    all.sort_unstable();
    all.dedup();
    all
}

fn same_headers<'a>(
    tables: &[Table],
    columns: impl IntoIterator<Item = &'a ColumnGuess> + Clone,
) -> Result<(), FirstGuessError> {
    for table in &tables[1..] {
        if let Some(lacking) = columns.clone().into_iter().find(|column| table.column(&column.name).is_none()) {
            return Err(FirstGuessError::OtherHeader {
                path: table.path.clone(),
                column: lacking.name.clone(),
                first: tables[0].path.clone(),
                available: table.header(),
            });
        }
    }
    Ok(())
}
