// A step of Adam (Kingma, Ba 2015, algorithm 1) on all parameters of a network, after clipping the norm of its gradient:
//
//     g <- g min(1, clip / (|g| + 1e-6))        m <- b1 m + (1 - b1) g        v <- b2 v + (1 - b2) g^2
//     p <- p - rate / (1 - b1^t) m / (sqrt(v / (1 - b2^t)) + epsilon)
//
// and then of running averages of the parameters: a <- a + share (p - a). Sums are made in one order, whatever the threads.

#include <cmath>
#include <cstdint>
#include <vector>

#include "packing.h"

namespace {

constexpr Index CHUNK = 4096;

struct Chunk {
    Index parameter, first, count, place;  // `place`: among the numbers of all parameters.
};

std::vector<Chunk> chunks(Index count, const std::int64_t* sizes) {
    std::vector<Chunk> found;
    Index before = 0;
    for (Index i = 0; i < count; before += sizes[i++])
        for (Index first = 0; first < sizes[i]; first += CHUNK)
            found.push_back({i, first, std::min(CHUNK, Index(sizes[i]) - first), before + first});
    return found;
}

// Adds up the gradients of all threads in the first one's row, clears the other rows and gives the norm of the sum.
double add_up(const std::vector<Chunk>& parts, float* gradients, Index rows, Index stride, int threads) {
    std::vector<float> squares(parts.size());
#pragma omp parallel for num_threads(threads) schedule(static)
    for (std::size_t i = 0; i < parts.size(); ++i) {
        const Chunk part = parts[i];
        float* __restrict g = gradients + part.place;
        for (Index row = 1; row < rows; ++row) {
            float* __restrict more = g + row * stride;
#pragma omp simd
            for (Index j = 0; j < part.count; ++j) {
                g[j] += more[j];
                more[j] = 0;
            }
        }
        float sum = 0;
#pragma omp simd reduction(+ : sum)
        for (Index j = 0; j < part.count; ++j) sum += g[j] * g[j];
        squares[i] = sum;
    }
    double sum = 0;
    for (const float square : squares) sum += square;
    return std::sqrt(sum);
}

}  // namespace

extern "C" {

// s: numbers of parameters, of averages and of rows of gradients, and the length of a row; sizes of the parameters. A row
// begins with the gradients of all parameters, one after the other, and these are cleared. `steps` counts each parameter's
// steps. `averages` holds those of all parameters one average after the other. r: clip (0: none), rate, b1, b2, epsilon.
void adam_step_float32(const std::int64_t* s, const std::int64_t* sizes, int threads, float* const* parameters,
                       float* const* first_moments, float* const* second_moments, float* const* steps, float* gradients,
                       float* const* averages, const float* shares, const double* r) {
    const std::vector<Chunk> parts = chunks(s[0], sizes);
    const double clip = r[0], rate = r[1], b1 = r[2], b2 = r[3], norm = add_up(parts, gradients, s[2], s[3], threads);
    const float scale = clip > 0 ? float(std::min(1.0, clip / (norm + 1e-6))) : 1.0f;
    for (Index i = 0; i < s[0]; ++i) *steps[i] += 1;
    const float keep1 = float(b1), keep2 = float(b2), take1 = float(1 - b1), take2 = float(1 - b2), epsilon = float(r[4]);
#pragma omp parallel for num_threads(threads) schedule(static)
    for (std::size_t i = 0; i < parts.size(); ++i) {
        const auto [parameter, first, count, place] = parts[i];
        const double step = *steps[parameter];
        const float size = float(rate / (1 - std::pow(b1, step))), root = float(1 / std::sqrt(1 - std::pow(b2, step)));
        float* __restrict p = parameters[parameter] + first;
        float* __restrict m = first_moments[parameter] + first;
        float* __restrict v = second_moments[parameter] + first;
        float* __restrict g = gradients + place;
#pragma omp simd
        for (Index j = 0; j < count; ++j) {
            const float own = g[j] * scale;
            g[j] = 0;
            m[j] = keep1 * m[j] + take1 * own;
            v[j] = keep2 * v[j] + take2 * own * own;
            p[j] -= size * m[j] / (std::sqrt(v[j]) * root + epsilon);
        }
        for (Index k = 0; k < s[1]; ++k) {
            float* __restrict a = averages[k * s[0] + parameter] + first;
            const float share = shares[k];
#pragma omp simd
            for (Index j = 0; j < count; ++j) a[j] += share * (p[j] - a[j]);
        }
    }
}
}
