"""Pinocchio in C++: its tree has a joint per row of the table that turns, of which some follow others (the parallelogram).

With `v = G dq`: `G^T M G ddq = tau - G^T (b(q, G dq))`, by Pinocchio's `crba` and `nonLinearEffects` and a Cholesky
decomposition of fixed size.
"""

from robot import Robot


def source(robot: Robot) -> str:
    def matrix(rows):
        return ", ".join(repr(float(value)) for row in rows for value in row)

    lines = []
    for k, joint in enumerate(robot.joints):
        parent = "0" if joint["parent"] is None else f"id[{joint['parent']}]"
        lines.append(
            f"    id[{k}] = model.addJoint({parent}, JointModelRZ(), place({{{matrix(joint['place'])}}}), \"j{k}\");"
        )
    for joint, mass, centroid, inertia in robot.bodies:
        lines.append(
            f"    model.appendBodyToJoint(id[{joint}], body({mass!r}, {{{matrix([centroid])}}}, {{{matrix(inertia)}}}));"
        )
    m = len(robot.joints)
    slopes = matrix([joint["slope"] for joint in robot.joints])
    gravity = ", ".join(repr(-float(value)) for value in robot.up)
    return f"""
#include <array>
#include <optional>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>
#include "simulation.h"
using namespace pinocchio;
constexpr int M = {m};
typedef Eigen::Matrix<double, M, N> Slopes;
typedef Eigen::Matrix<double, N, 1> Vector;
typedef Eigen::Matrix<double, N, N> Square;
static Model model;
static std::optional<Data> data;
static Slopes slopes;
static Eigen::VectorXd tree_q(M), tree_v(M);
static SE3 place(const std::array<double, 16> &p) {{
    Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(p.data());
    return SE3(Eigen::Matrix3d(matrix.topLeftCorner<3, 3>()), Eigen::Vector3d(matrix.topRightCorner<3, 1>()));
}}
static Inertia body(double mass, const std::array<double, 3> &c, const std::array<double, 9> &i) {{
    return Inertia(mass, Eigen::Vector3d(c.data()), Eigen::Matrix3d(Eigen::Map<const Eigen::Matrix3d>(i.data())));
}}
static void forward(const double *q, const double *dq, const double *tau, double *ddq) {{
    tree_q.noalias() = slopes * Eigen::Map<const Vector>(q);
    tree_v.noalias() = slopes * Eigen::Map<const Vector>(dq);
    crba(model, *data, tree_q, Convention::WORLD);
    data->M.triangularView<Eigen::StrictlyLower>() = data->M.transpose().triangularView<Eigen::StrictlyLower>();
    nonLinearEffects(model, *data, tree_q, tree_v);
    const Square inertia = slopes.transpose() * (data->M * slopes);
    const Vector right = Eigen::Map<const Vector>(tau) - slopes.transpose() * data->nle;
    Eigen::Map<Vector> result(ddq);
    result = inertia.llt().solve(right);
}}
int main(int count, char **words) {{
    std::array<JointIndex, M> id;
{chr(10).join(lines)}
    model.gravity.linear() = Eigen::Vector3d({gravity});
    data.emplace(model);
    const std::array<double, M * N> flat = {{{slopes}}};
    slopes = Eigen::Map<const Eigen::Matrix<double, M, N, Eigen::RowMajor>>(flat.data());
    return count == 2 ? measure(words[1]) : 1;
}}
"""
