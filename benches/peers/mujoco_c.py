"""MuJoCo by its C library, which is in the Python package."""

from mujoco_robot import slopes
from robot import Robot


def source(robot: Robot) -> str:
    m = len(robot.joints)
    table = ", ".join(repr(float(value)) for row in slopes(robot) for value in row)
    return f"""
#include <mujoco/mujoco.h>
#include "simulation.h"
#define M {m}
static const double slopes[M][N] = {{{table}}};
static mjModel *model;
static mjData *data;
static void forward(const double *q, const double *dq, const double *tau, double *ddq) {{
    static double inertia[M * M], bias[M], half[M][N], d[N][N], x[N];
    for (int k = 0; k < M; k++) {{
        data->qpos[k] = data->qvel[k] = 0;
        for (int i = 0; i < N; i++) data->qpos[k] += slopes[k][i] * q[i], data->qvel[k] += slopes[k][i] * dq[i];
    }}
    mj_kinematics(model, data);
    mj_comPos(model, data);
    mj_makeM(model, data);
    mj_comVel(model, data);
    mj_rne(model, data, 0, bias);
    mj_fullM(model, data, inertia);
    for (int k = 0; k < M; k++)
        for (int i = 0; i < N; i++) {{
            half[k][i] = 0;
            for (int l = 0; l < M; l++) half[k][i] += inertia[k * M + l] * slopes[l][i];
        }}
    for (int i = 0; i < N; i++) {{
        x[i] = tau[i];
        for (int k = 0; k < M; k++) x[i] -= slopes[k][i] * bias[k];
        for (int j = 0; j <= i; j++) {{
            d[i][j] = 0;
            for (int k = 0; k < M; k++) d[i][j] += slopes[k][i] * half[k][j];
        }}
    }}
    // D x = tau - b by Cholesky
    for (int i = 0; i < N; i++) {{
        for (int j = 0; j <= i; j++) {{
            for (int k = 0; k < j; k++) d[i][j] -= d[i][k] * d[j][k];
            d[i][j] = i == j ? sqrt(d[i][i]) : d[i][j] / d[j][j];
        }}
        for (int k = 0; k < i; k++) x[i] -= d[i][k] * x[k];
        x[i] /= d[i][i];
    }}
    for (int i = N - 1; i >= 0; i--) {{
        for (int k = i + 1; k < N; k++) x[i] -= d[k][i] * x[k];
        ddq[i] = x[i] /= d[i][i];
    }}
}}
int main(int count, char **words) {{
    char error[1000] = "";
    model = mj_loadXML("robot.xml", 0, error, sizeof error);
    if (!model) {{
        fputs(error, stderr);
        return 1;
    }}
    data = mj_makeData(model);
    return count == 2 ? measure(words[1]) : 1;
}}
"""
