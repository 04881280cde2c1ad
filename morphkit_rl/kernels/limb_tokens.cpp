// Limb tokens from named scalars, forward and backward. For row b and limb l, whose scalars v_i have the vectors t_i:
//
//     y = sum_i v_i t_i + n_l        result = norm(y)
//
// Norms have no scale and shift. Each thread takes whole limbs. The y are kept for the way back. Sums are float32. Members
// are independent tokens of the same scalars.

#include <omp.h>

#include "rows.h"

namespace {

struct Problem {
    Index members, batch, limbs, width, row_width, texts;
    const std::int64_t *firsts, *columns, *text;  // Limb l has the scalars from firsts[l] to firsts[l + 1].
    const float *row, *table, *names;

    Index scalars(Index limb) const { return firsts[limb + 1] - firsts[limb]; }
    Index place(Index member, Index limb, Index b) const { return ((member * batch + b) * limbs + limb) * width; }
};

struct Scratch {
    Buffer values, vectors, packed, gradient, left, right, ones, zeros, wide;
};
thread_local Scratch scratch;

// The scalars of a limb, each row a whole number of words.
template <class T>
std::pair<const T*, Index> read(const Problem& p, Index limb) {
    const Index count = p.scalars(limb), size = words<T>(count) * Words<T>::size;
    T* out = scratch.values.of<T>(p.batch * size + LANES);
    float* wide = scratch.wide.of<float>(round_up(count, LANES));
    const std::int64_t* columns = p.columns + p.firsts[limb];
    for (Index b = 0; b < p.batch; ++b) {
        for (Index i = 0; i < count; ++i) wide[i] = p.row[b * p.row_width + columns[i]];
        T part[LANES];
        for (Index i = 0; i < size; i += LANES) {
            copy_part(wide + i, std::min(LANES, count - i), part);
            std::copy_n(part, std::min(LANES, size - i), out + b * size + i);
        }
    }
    return {out, size};
}

float* filled(Buffer& buffer, Index n, float x) {
    float* out = buffer.of<float>(n);
    std::fill(out, out + n, x);
    return out;
}

template <class T>
void forward(const Problem& p, int threads, T* kept, T* result) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (Index part = 0; part < p.members * p.limbs; ++part) {
        const Index limb = part % p.limbs, member = part / p.limbs, count = p.scalars(limb), width = p.width;
        const float *name = p.names + part * width, *ones = filled(scratch.ones, width, 1), *zeros = filled(scratch.zeros, width, 0);
        T* vectors = scratch.vectors.of<T>(count * width);
        for (Index i = 0; i < count; ++i)
            copy(p.table + (member * p.texts + p.text[p.firsts[limb] + i]) * width, width, vectors + i * width);
        Word<T>* packed = scratch.packed.of<Word<T>>(packed_size<T>(count, width));
        pack(vectors, width, count, width, packed);
        const auto [values, size] = read<T>(p, limb);
        product(p.batch, width, words<T>(count), as_words(values), words<T>(count), 1, packed, [&](Index b, float* sum) {
            T* y = kept ? kept + p.place(member, limb, b) : scratch.gradient.of<T>(width);
            for (Index i = 0; i < width; i += LANES) store(y + i, load(sum + i) + load(name + i));
            normalize(moments(y, width), y, width, ones, zeros, result + p.place(member, limb, b));
        });
    }
}

// Adds to each thread's gradient of the table and of the names.
template <class T>
void backward(const Problem& p, int threads, const T* kept, const T* result_gradient, float* const* gradients) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (Index part = 0; part < p.members * p.limbs; ++part) {
        const Index limb = part % p.limbs, member = part / p.limbs, count = p.scalars(limb), width = p.width;
        float* const* mine = gradients + 2 * omp_get_thread_num();
        const float* ones = filled(scratch.ones, width, 1);
        T* g = scratch.gradient.of<T>(p.batch * width);
        for (Index b = 0; b < p.batch; ++b) {
            const T* y = kept + p.place(member, limb, b);
            float* wide = scratch.zeros.of<float>(width);
            copy(result_gradient + p.place(member, limb, b), width, wide);
            normalize_backward<T>(moments(y, width), y, width, ones, wide, nullptr, nullptr, g + b * width);
            add(g + b * width, width, mine[1] + part * width);
        }
        const auto [values, size] = read<T>(p, limb);
        Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(p.batch, width));
        const Left<T> left = transpose_left(values, size, p.batch, count, scratch.left);
        pack(g, width, p.batch, width, right);
        product(count, width, p.batch, left, right, [&](Index i, const float* sum) {
            add(sum, width, mine[0] + (member * p.texts + p.text[p.firsts[limb] + i]) * width);
        });
    }
}

Problem problem(const std::int64_t* s, const std::int64_t* firsts, const std::int64_t* columns, const std::int64_t* text,
                const float* row, const float* table, const float* names) {
    return {s[0], s[1], s[2], s[3], s[4], s[5], firsts, columns, text, row, table, names};
}

}  // namespace

extern "C" {

// s: members, batch, limbs, width, width of a row, numbers of vectors. Table: (members, vectors, width), names: (members,
// limbs, width), result: (members, batch, limbs, width).
#define DEFINE(NAME, T)                                                                                                \
    void limb_tokens_forward_##NAME(const std::int64_t* s, int threads, const std::int64_t* firsts,                    \
                                    const std::int64_t* columns, const std::int64_t* text, const float* row,           \
                                    const float* table, const float* names, T* kept, T* result) {                      \
        forward<T>(problem(s, firsts, columns, text, row, table, names), threads, kept, result);                       \
    }                                                                                                                  \
    void limb_tokens_backward_##NAME(const std::int64_t* s, int threads, const std::int64_t* firsts,                   \
                                     const std::int64_t* columns, const std::int64_t* text, const float* row,          \
                                     const float* table, const float* names, const T* kept, const T* gradient,         \
                                     float* const* gradients) {                                                        \
        backward<T>(problem(s, firsts, columns, text, row, table, names), threads, kept, gradient, gradients);         \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
