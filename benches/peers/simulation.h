// What the compiled peers share: 60 s by Runge-Kutta at 1/6 ms with held commands, gain, LuGre friction (thesis Eqs 3.6
// to 3.8) and cable spring; and the cost of one call of the forward dynamics. The robot's numbers come from `numbers.h`,
// written by the script.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "numbers.h"

static void forward(const double *q, const double *dq, const double *tau, double *ddq);

static void rate(const double *x, const double *drive, double *dx) {
    double tau[N];
    for (int i = 0; i < N; i++) {
        const double v = x[N + i], z = x[2 * N + i], ratio = v / vs[i];
        const double g = Fc[i] + (Fs[i] - Fc[i]) * exp(-(ratio * ratio));
        const double dz = v - sigma0[i] * fabs(v) / g * z;
        dx[i] = v;
        dx[2 * N + i] = dz;
        tau[i] = drive[i] - (sigma0[i] * z + sigma1[i] * dz + sigma2[i] * v) - Ks[i] * (x[i] - qeq[i]);
    }
    forward(x, x + N, tau, dx + N);
}

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void simulate(const double *commands, double *x) {
    const double h = 0.01 / SUBSTEPS;
    double k[3 * N], sum[3 * N], y[3 * N], drive[N];
    for (int sample = 0; sample + 1 < SAMPLES; sample++) {
        for (int i = 0; i < N; i++) drive[i] = Kp[i] * commands[sample * N + i];
        for (int step = 0; step < SUBSTEPS; step++) {
            rate(x, drive, k);
            for (int i = 0; i < 3 * N; i++) sum[i] = k[i], y[i] = x[i] + 0.5 * h * k[i];
            rate(y, drive, k);
            for (int i = 0; i < 3 * N; i++) sum[i] += 2 * k[i], y[i] = x[i] + 0.5 * h * k[i];
            rate(y, drive, k);
            for (int i = 0; i < 3 * N; i++) sum[i] += 2 * k[i], y[i] = x[i] + h * k[i];
            rate(y, drive, k);
            for (int i = 0; i < 3 * N; i++) x[i] += h / 6 * (sum[i] + k[i]);
        }
    }
}

static int measure(const char *file) {
    static double commands[SAMPLES * N];
    FILE *input = fopen(file, "rb");
    if (!input || fread(commands, sizeof(double), SAMPLES * N, input) != SAMPLES * N) return 1;
    fclose(input);
    double best = 1e9, x[3 * N];
    for (int repeat = 0; repeat < 5; repeat++) {
        for (int i = 0; i < 3 * N; i++) x[i] = i < N ? start[i] : 0;
        const double begin = seconds();
        simulate(commands, x);
        const double took = seconds() - begin;
        best = took < best ? took : best;
    }
    double q[N], dq[N], tau[N], ddq[N], first[N], call = 1e9;
    for (int i = 0; i < N; i++) q[i] = 0.4 - 0.15 * i, dq[i] = 0.7 - 0.2 * i, tau[i] = sin(i);
    forward(q, dq, tau, first);
    for (int repeat = 0; repeat < 5; repeat++) {
        const int calls = 200000;
        for (int i = 0; i < N; i++) q[i] = 0.4 - 0.15 * i;
        const double begin = seconds();
        for (int k = 0; k < calls; k++) {
            forward(q, dq, tau, ddq);
            // The posture hardly moves, but the next call has to wait for this one.
            for (int i = 0; i < N; i++) q[i] = 0.4 - 0.15 * i + 1e-9 * ddq[i];
        }
        const double took = (seconds() - begin) / calls;
        call = took < call ? took : call;
    }
    printf("{\"simulate\": %.6f, \"forward_dynamics\": %.12f, \"last\": [", best, call);
    for (int i = 0; i < N; i++) printf("%s%.15g", i ? ", " : "", x[i]);
    printf("], \"ddq\": [");
    for (int i = 0; i < N; i++) printf("%s%.15g", i ? ", " : "", first[i]);
    printf("]}\n");
    return 0;
}
