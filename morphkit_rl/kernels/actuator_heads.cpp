// Actions from limb tokens, forward and backward. For action a of limb token x, with the action's vector u_a:
//
//     h = relu( norm(x) W + b + u_a )        action = tanh( w . h + c )
//
// Norms have no scale and shift. Each thread carries blocks of samples through. The h are kept for the way back. Sums are
// float32.

#include <cmath>
#include <omp.h>

#include "rows.h"

namespace {

constexpr Index BLOCK_ROWS = 128;  // About so many actions a block.

enum { READ, READ_BIAS, NAMES, HEAD, HEAD_BIAS, PARAMETERS };

struct Problem {
    Index batch, limbs, actions, width;
    const std::int64_t* limb;  // That each action reads.
    const float* const* parameters;

    Index samples_a_block() const { return std::max<Index>(1, BLOCK_ROWS / actions); }
    Index blocks() const { return (batch + samples_a_block() - 1) / samples_a_block(); }
};

struct Scratch {
    Buffer normed, hidden, gradient, left, right, ones, zeros, narrowed, packed;
};
thread_local Scratch scratch;

template <class T>
const T* norm(const Problem& p, const T* x, Index first, Index samples) {
    const Index width = p.width;
    float *ones = scratch.ones.of<float>(width), *zeros = scratch.zeros.of<float>(width);
    std::fill(ones, ones + width, 1.0f);
    std::fill(zeros, zeros + width, 0.0f);
    T* out = scratch.normed.of<T>(samples * p.actions * width);
    for (Index r = 0; r < samples * p.actions; ++r) {
        const T* own = x + ((first + r / p.actions) * p.limbs + p.limb[r % p.actions]) * width;
        normalize(moments(own, width), own, width, ones, zeros, out + r * width);
    }
    return out;
}

template <class T>
const Word<T>* packed_read(const Problem& p, bool transposed) {
    const Index width = p.width;
    T* narrowed = scratch.narrowed.of<T>(width * width);
    copy(p.parameters[READ], width * width, narrowed);
    Word<T>* out = scratch.packed.of<Word<T>>(packed_size<T>(width, width));
    transposed ? pack_transposed(narrowed, width, width, width, out) : pack(narrowed, width, width, width, out);
    return out;
}

template <class T>
void forward(const Problem& p, int threads, const T* x, T* kept, float* result) {
    const Index width = p.width, words_of_a_row = words<T>(width);
#pragma omp parallel num_threads(threads)
    {
        const Word<T>* read = packed_read<T>(p, false);
#pragma omp for schedule(static)
        for (Index block = 0; block < p.blocks(); ++block) {
            const Index first = block * p.samples_a_block(), samples = std::min(p.samples_a_block(), p.batch - first),
                        rows = samples * p.actions, row = first * p.actions;
            product(rows, width, words_of_a_row, as_words(norm(p, x, first, samples)), words_of_a_row, 1, read,
                    [&](Index r, const float* values) {
                const float* name = p.parameters[NAMES] + r % p.actions * width;
                T* h = kept ? kept + (row + r) * width : scratch.hidden.of<T>(width);
                Floats sum = {};
                for (Index i = 0; i < width; i += LANES) {
                    const Floats before = load(values + i) + load(p.parameters[READ_BIAS] + i) + load(name + i);
                    store(h + i, before > 0 ? before : all(0));
                    sum += load(h + i) * load(p.parameters[HEAD] + i);
                }
                result[row + r] = std::tanh(total(sum) + *p.parameters[HEAD_BIAS]);
            });
        }
    }
}

// Adds to x_gradient, and to each thread's gradients of the parameters.
template <class T>
void backward(const Problem& p, int threads, const T* x, const T* kept, const float* result,
              const float* result_gradient, T* x_gradient, float* const* gradients) {
    const Index width = p.width, words_of_a_row = words<T>(width);
#pragma omp parallel num_threads(threads)
    {
        const Word<T>* read = packed_read<T>(p, true);
        float* const* mine = gradients + PARAMETERS * omp_get_thread_num();
#pragma omp for schedule(static)
        for (Index block = 0; block < p.blocks(); ++block) {
            const Index first = block * p.samples_a_block(), samples = std::min(p.samples_a_block(), p.batch - first),
                        rows = samples * p.actions, row = first * p.actions;
            T* g = scratch.gradient.of<T>(rows * width);
            for (Index r = 0; r < rows; ++r) {
                const float action = result[row + r], slope = result_gradient[row + r] * (1 - action * action);
                const T* h = kept + (row + r) * width;
                float *name = mine[NAMES] + r % p.actions * width;
                *mine[HEAD_BIAS] += slope;
                for (Index i = 0; i < width; i += LANES) {
                    const Floats own = load(h + i), passed = own > 0 ? load(p.parameters[HEAD] + i) * slope : all(0);
                    store(g + r * width + i, passed);
                    store(name + i, load(name + i) + passed);
                    store(mine[READ_BIAS] + i, load(mine[READ_BIAS] + i) + passed);
                    store(mine[HEAD] + i, load(mine[HEAD] + i) + own * slope);
                }
            }
            const T* normed = norm(p, x, first, samples);
            const float* ones = scratch.ones.of<float>(width);
            Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(rows, width));
            const Left<T> left = transpose_left(normed, width, rows, width, scratch.left);
            pack(g, width, rows, width, right);
            product(width, width, rows, left, right,
                    [&](Index i, const float* values) { add(values, width, mine[READ] + i * width); });
            product(rows, width, words_of_a_row, as_words(g), words_of_a_row, 1, read, [&](Index r, float* values) {
                const Index place = ((first + r / p.actions) * p.limbs + p.limb[r % p.actions]) * width;
                T* out = scratch.hidden.of<T>(width);
                normalize_backward<T>(moments(x + place, width), x + place, width, ones, values, nullptr, nullptr, out);
                for (Index i = 0; i < width; i += LANES)
                    store(x_gradient + place + i, load(x_gradient + place + i) + load(out + i));
            });
        }
    }
}

}  // namespace

extern "C" {

// s: batch, limbs, actions, width. x: (batch, limbs, width), result: (batch, actions).
#define DEFINE(NAME, T)                                                                                                \
    void heads_forward_##NAME(const std::int64_t* s, int threads, const std::int64_t* limb,                            \
                              const float* const* parameters, const T* x, T* kept, float* result) {                    \
        forward<T>({s[0], s[1], s[2], s[3], limb, parameters}, threads, x, kept, result);                              \
    }                                                                                                                  \
    void heads_backward_##NAME(const std::int64_t* s, int threads, const std::int64_t* limb,                           \
                               const float* const* parameters, const T* x, const T* kept, const float* result,         \
                               const float* gradient, T* x_gradient, float* const* gradients) {                        \
        backward<T>({s[0], s[1], s[2], s[3], limb, parameters}, threads, x, kept, result, gradient, x_gradient,        \
                    gradients);                                                                                        \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
