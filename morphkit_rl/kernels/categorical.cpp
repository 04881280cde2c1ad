// What critics with categorical values learn, and what an actor climbs (Bellemare, Dabney, Munos 2017, algorithm 1). With
// atoms z_1, ..., z_n from -support to support, logits q of two members, and p = softmax(q) with the mean sum_i p_i z_i:
//
//     target = projection of reward + discount z under the p of the next logits whose mean is smaller
//     error  = sum over members of  - sum_i target_i log p_i            its gradient: p - target
//     value  = mean over members of sum_i p_i z_i                       its gradient: p (z - mean) / members
//
// Rows of logits are samples, and in them robots.

#include <omp.h>

#include <vector>

#include "rows.h"

namespace {

struct Atoms {
    Index count;
    float support;

    Index padded() const { return round_up(count, LANES); }
    float step() const { return 2 * support / (count - 1); }
    Floats values(Index first) const { return __builtin_convertvector(lanes() + std::int32_t(first), Floats) * step() - support; }
};

struct Scratch {
    Buffer first, second, target;
};
thread_local Scratch scratch;

struct Distribution {
    float mean, log_sum;  // log_sum: log of the sum of e^q.
};

// Writes softmax(q), padded with zeros.
Distribution distribute(const Atoms& atoms, const float* q, float* out) {
    const Index n = atoms.count, padded = atoms.padded();
    std::memcpy(out, q, n * sizeof(float));
    std::fill(out + n, out + padded, -std::numeric_limits<float>::infinity());
    Floats most = load(out), sum = {}, weighted = {};
    for (Index i = LANES; i < padded; i += LANES) most = load(out + i) > most ? load(out + i) : most;
    const float top = greatest(most);
    for (Index i = 0; i < padded; i += LANES) {
        const Floats power = used(exponential(load(out + i) - top), n - i, 0);
        sum += power;
        weighted += power * atoms.values(i);
        store(out + i, power);
    }
    const float whole = total(sum), share = 1 / whole;
    for (Index i = 0; i < padded; i += LANES) store(out + i, load(out + i) * share);
    return {total(weighted) * share, top + std::log(whole)};
}

// Writes the distribution of reward + discount z; what lies beyond the atoms goes to the outermost.
void project(const Atoms& atoms, const float* p, float reward, float discount, float* out) {
    const Index n = atoms.count;
    std::fill(out, out + atoms.padded(), 0.0f);
    const float scale = 1 / atoms.step(), support = atoms.support;
    for (Index i = 0; i < n; ++i) {
        const float moved = std::min(std::max(reward + discount * (i * atoms.step() - support), -support), support);
        const float place = (moved + support) * scale;
        const Index below = std::min(Index(place), n - 2);
        const float upper = p[i] * (place - below);
        out[below] += p[i] - upper;
        out[below + 1] += upper;
    }
}

}  // namespace

extern "C" {

// s: samples, robots, atoms. r: support. Writes the gradient of sum over rows of weight error, and adds to `result` that sum
// and the sum of value_weight value; weights and `reward_scale` are robot by robot. Sums are made in one order, whatever the
// threads.
void categorical_error_float32(const std::int64_t* s, const float* r, int threads, const float* logits,
                               const float* next_logits, const float* reward, const float* discount,
                               const float* reward_scale, const float* weight, const float* value_weight, float* gradient,
                               double* result) {
    const Atoms atoms{s[2], r[0]};
    const Index rows = s[0] * s[1], n = atoms.count;
    std::vector<double> errors(2 * rows), values(2 * rows);
#pragma omp parallel num_threads(threads)
    {
        float *first = scratch.first.of<float>(atoms.padded()), *second = scratch.second.of<float>(atoms.padded()),
              *target = scratch.target.of<float>(atoms.padded());
#pragma omp for schedule(static)
        for (Index row = 0; row < rows; ++row) {
            const Index robot = row % s[1];
            const float a = distribute(atoms, next_logits + row * n, first).mean,
                        b = distribute(atoms, next_logits + (rows + row) * n, second).mean;
            project(atoms, a < b ? first : second, reward[row] * reward_scale[robot], discount[row], target);
            for (Index member = 0; member < 2; ++member) {
                const Index place = member * rows + row;
                const float* q = logits + place * n;
                float* out = gradient + place * n;
                const Distribution own = distribute(atoms, q, first);
                float along = 0;
#pragma omp simd reduction(+ : along)
                for (Index i = 0; i < n; ++i) along += target[i] * q[i];
#pragma omp simd
                for (Index i = 0; i < n; ++i) out[i] = weight[robot] * (first[i] - target[i]);
                errors[2 * row + member] = weight[robot] * (own.log_sum - along);
                values[2 * row + member] = value_weight[robot] * own.mean / 2;
            }
        }
    }
    for (Index i = 0; i < 2 * rows; ++i) {
        result[0] += errors[i];
        result[1] += values[i];
    }
}

// s: members, samples, robots, atoms. Writes the gradient of sum over rows of weight value, and adds that sum to `result`.
void categorical_value_float32(const std::int64_t* s, const float* r, int threads, const float* logits, const float* weight,
                               float* gradient, double* result) {
    const Atoms atoms{s[3], r[0]};
    const Index n = atoms.count, rows = s[0] * s[1] * s[2];
    std::vector<double> values(rows);
#pragma omp parallel num_threads(threads)
    {
        float* p = scratch.first.of<float>(atoms.padded());
#pragma omp for schedule(static)
        for (Index row = 0; row < rows; ++row) {
            const float own = weight[row % s[2]] / s[0];
            const float mean = distribute(atoms, logits + row * n, p).mean;
            float* out = gradient + row * n;
#pragma omp simd
            for (Index i = 0; i < n; ++i) out[i] = own * p[i] * (i * atoms.step() - atoms.support - mean);
            values[row] = own * mean;
        }
    }
    for (const double value : values) result[0] += value;
}
}
