// Reading of few probes in many tokens: softmax(p t^T) t, robot by robot, forward and backward.
//
// Rows of probes are (batch, heads, queries), those of tokens (batch, tokens). Sums are float32; weights are computed
// again on the way back.

#include <omp.h>

#include "rows.h"

namespace {

struct Sizes {
    Index batch, robots, heads, width;
    const std::int64_t *queries, *tokens;  // First query and token of each robot, and their numbers.
};

// A thread's working memory.
struct Scratch {
    Buffer right, weights, by_width, by_token, left, packed;
};

template <class T>
class Reader {
  public:
    // Of one robot in one sample.
    Reader(const Sizes& sizes, Index sample, Index robot, const T* all_probes, const T* all_tokens)
        : sizes(sizes), sample(sample), first(sizes.queries[robot]), queries(sizes.queries[robot + 1] - first),
          rows(sizes.heads * queries), start(sample * sizes.tokens[sizes.robots] + sizes.tokens[robot]),
          count(sizes.tokens[robot + 1] - sizes.tokens[robot]), ld(round_up(count, LANES)),
          tokens(all_tokens + start * sizes.width) {
        probes = scratch.right.of<T>(2 * rows * sizes.width) + rows * sizes.width;  // Behind the gradient of the result.
        weights = scratch.weights.of<T>(2 * rows * ld);
        gather(all_probes, probes);
        by_width = scratch.by_width.of<Word<T>>(packed_size<T>(sizes.width, count));
        by_token = scratch.by_token.of<Word<T>>(packed_size<T>(count, sizes.width));
        pack_transposed(tokens, sizes.width, sizes.width, count, by_width);
        pack(tokens, sizes.width, count, sizes.width, by_token);
        product(rows, count, words<T>(sizes.width), as_words(probes), words<T>(sizes.width), 1, by_width,
                [&](Index r, float* logits) { softmax(logits, count, 1, weights + r * ld); });
    }

    void forward(T* result) { mix(weights, result); }

    void backward(const T* result_gradient, T* probes_gradient, T* tokens_gradient) {
        T *gradient = probes - rows * sizes.width, *logits = weights + rows * ld;
        gather(result_gradient, gradient);
        product(rows, count, words<T>(sizes.width), as_words(gradient), words<T>(sizes.width), 1, by_width,
                [&](Index r, const float* g) { softmax_backward(weights + r * ld, ld, 1, g, logits + r * ld); });
        mix(logits, probes_gradient);
        // Tokens are values and keys: weights^T gradient + logits^T probes, as one product of what lies behind each other.
        Word<T>* packed = scratch.packed.of<Word<T>>(packed_size<T>(2 * rows, sizes.width));
        const Left<T> left = transpose_left(weights, ld, 2 * rows, count, scratch.left);
        pack(gradient, sizes.width, 2 * rows, sizes.width, packed);
        product(count, sizes.width, 2 * rows, left, packed, [&](Index r, const float* g) {
            copy(g, sizes.width, tokens_gradient + (start + r) * sizes.width);
        });
    }

  private:
    const Sizes& sizes;
    const Index sample, first, queries, rows, start, count, ld;
    const T* tokens;
    T *probes, *weights;
    Word<T> *by_width, *by_token;

    inline static thread_local Scratch scratch;

    // Where row r of this robot's probes lies among all.
    Index at(Index r) const {
        const Index all = sizes.queries[sizes.robots];
        return ((sample * sizes.heads + r / queries) * all + first + r % queries) * sizes.width;
    }
    void gather(const T* all, T* own) const {
        for (Index r = 0; r < rows; ++r) std::copy_n(all + at(r), sizes.width, own + r * sizes.width);
    }
    void mix(const T* shares, T* all) const {
        product(rows, sizes.width, words<T>(count), as_words(shares), words<T>(ld), 1, by_token,
                [&](Index r, const float* mixed) { copy(mixed, sizes.width, all + at(r)); });
    }
};

template <class T, class Work>
void for_all(const Sizes& sizes, int threads, const T* probes, const T* tokens, Work&& work) {
#pragma omp parallel for num_threads(threads) schedule(static)
    for (Index part = 0; part < sizes.batch * sizes.robots; ++part) {
        Reader<T> reader(sizes, part / sizes.robots, part % sizes.robots, probes, tokens);
        work(reader);
    }
}

}  // namespace

extern "C" {

// s: batch, robots, heads, width, which is a multiple of 16; queries and tokens as in `Sizes`.
#define DEFINE(NAME, T)                                                                                               \
    void read_forward_##NAME(const std::int64_t* s, const std::int64_t* queries, const std::int64_t* tokens,          \
                             int threads, const T* p, const T* t, T* result) {                                        \
        for_all({s[0], s[1], s[2], s[3], queries, tokens}, threads, p, t,                                             \
                [&](Reader<T>& reader) { reader.forward(result); });                                                  \
    }                                                                                                                 \
    void read_backward_##NAME(const std::int64_t* s, const std::int64_t* queries, const std::int64_t* tokens,         \
                              int threads, const T* p, const T* t, const T* gradient, T* p_gradient, T* t_gradient) { \
        for_all({s[0], s[1], s[2], s[3], queries, tokens}, threads, p, t,                                             \
                [&](Reader<T>& reader) { reader.backward(gradient, p_gradient, t_gradient); });                       \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
