"""C that CasADi writes for the forward dynamics, compiled with the system's C compiler."""

import casadi as ca
import numpy as np

from robot import Robot


def source(robot: Robot) -> str:
    n = robot.n
    q, dq, tau = (ca.SX.sym(name, n) for name in ("q", "dq", "tau"))
    zeros = [0.0] * n
    variables = [q[i] for i in range(n)]
    rates = [dq[i] for i in range(n)]
    h = robot.inverse_dynamics(variables, rates, zeros, ca.sin, ca.cos)
    d = [robot.inverse_dynamics(variables, zeros, list(np.eye(n)[k]), ca.sin, ca.cos, gravity=0.0) for k in range(n)]
    # D x = tau - h by L d L^T, unrolled
    x = [tau[i] - h[i] for i in range(n)]
    low, pivot = {}, []
    for i in range(n):
        for j in range(i):
            entry = d[j][i] - sum((low[i, k] * low[j, k] * pivot[k] for k in range(j)), 0)
            low[i, j] = entry / pivot[j]
        pivot.append(d[i][i] - sum((low[i, k] ** 2 * pivot[k] for k in range(i)), 0))
        x[i] = x[i] - sum((low[i, k] * x[k] for k in range(i)), 0)
    for i in reversed(range(n)):
        x[i] = x[i] / pivot[i] - sum((low[k, i] * x[k] for k in range(i + 1, n)), 0)
    function = ca.Function("dynamics", [q, dq, tau], [ca.cse(ca.vertcat(*x))])
    generator = ca.CodeGenerator("dynamics.c", {"with_header": False})
    generator.add(function)
    text = generator.dump()
    return text + """
#include "simulation.h"
static void forward(const double *q, const double *dq, const double *tau, double *ddq) {
    const double *arguments[3] = {q, dq, tau};
    double *results[1] = {ddq};
    dynamics(arguments, results, 0, 0, 0);
}
int main(int count, char **words) { return count == 2 ? measure(words[1]) : 1; }
"""
