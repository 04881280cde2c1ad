// A post-norm transformer encoder layer, forward and backward:
//
//     q, k, v = x W_qkv + b_qkv                  m = softmax(q k^T / sqrt(d_head)) v, head by head, sequence by sequence
//     y1 = m W_out + b_out + x                   x1 = norm1(y1)
//     h = relu(x1 W_expand + b_expand)           y2 = h W_contract + b_contract + x1        result = norm2(y2)
//
// Rows are tokens; sequences of them attend among themselves. Each thread takes whole sequences and carries a block of
// them through the layer, so that what lies between two products never leaves its cache. Sums are float32. Attention
// weights are computed again on the way back. Members are independent layers with rows of their own.

#include <cmath>
#include <omp.h>

#include "rows.h"

namespace {

constexpr Index BLOCK_ROWS = 128;  // At least so many rows a block, if there are: enough for products to pay.

enum { QKV, QKV_BIAS, OUT, OUT_BIAS, EXPAND, EXPAND_BIAS, CONTRACT, CONTRACT_BIAS,
       NORM1, NORM1_BIAS, NORM2, NORM2_BIAS, PARAMETERS };

struct Sizes {
    Index members, sequences, width, heads, hidden;
    const std::int64_t* starts;  // Row of each sequence's first token, and the number of rows.

    Index rows() const { return starts[sequences]; }
    Index head() const { return width / heads; }

    // Rows and columns of a parameter; biases and norms have one row.
    std::pair<Index, Index> shape(int parameter) const {
        switch (parameter) {
            case QKV: return {width, 3 * width};
            case OUT: return {width, width};
            case EXPAND: return {width, hidden};
            case CONTRACT: return {hidden, width};
            case QKV_BIAS: return {1, 3 * width};
            case EXPAND_BIAS: return {1, hidden};
            default: return {1, width};
        }
    }
    Index size(int parameter) const { return shape(parameter).first * shape(parameter).second; }
};

// Sequences [first, last) of a member, their rows, and where those start among the rows of all members.
struct Block {
    Index member, first, last, rows, row;
};

// Calls `work` with the blocks of one of the threads that run this.
template <class Work>
void for_own_blocks(const Sizes& sizes, Work&& work) {
    const Index threads = omp_get_num_threads(), thread = omp_get_thread_num(), rows = sizes.rows();
    const auto owner = [&](Index row) { return row * threads / (sizes.members * rows); };
    for (Index member = 0; member < sizes.members; ++member)
        for (Index first = 0; first < sizes.sequences;) {
            const Index row = member * rows + sizes.starts[first];
            Index last = first + 1;
            if (owner(row) == thread) {
                while (last < sizes.sequences && sizes.starts[last + 1] - sizes.starts[first] <= BLOCK_ROWS &&
                       owner(member * rows + sizes.starts[last]) == thread)
                    ++last;
                work(Block{member, first, last, sizes.starts[last] - sizes.starts[first], row});
            }
            first = last;
        }
}

// Weights of all members in panels, for x W or for g W^T.
template <class T>
class Packed {
  public:
    // To be called by all threads of a parallel region.
    void fill(const Sizes& sizes, const float* const* parameters, bool transposed) {
#pragma omp single
        for (int matrix = 0; matrix < 4; ++matrix) {
            const auto [k, n] = sizes.shape(2 * matrix);
            stride_[matrix] = transposed ? packed_size<T>(n, k) : packed_size<T>(k, n);
            memory_[matrix].template of<Word<T>>(stride_[matrix] * sizes.members);
        }
#pragma omp for schedule(dynamic)
        for (Index part = 0; part < 4 * sizes.members; ++part) {
            const Index matrix = part % 4, member = part / 4;
            const auto [k, n] = sizes.shape(2 * matrix);
            const float* weight = parameters[2 * matrix] + member * k * n;
            thread_local Buffer buffer;
            T* narrowed = buffer.of<T>(k * n);
            copy(weight, k * n, narrowed);
            Word<T>* out = memory_[matrix].template of<Word<T>>(0) + member * stride_[matrix];
            transposed ? pack_transposed(narrowed, n, n, k, out) : pack(narrowed, n, k, n, out);
        }
    }
    const Word<T>* get(int parameter, Index member) {
        return memory_[parameter / 2].template of<Word<T>>(0) + member * stride_[parameter / 2];
    }

  private:
    Buffer memory_[4];
    Index stride_[4];
};

// What the way back needs of the way forward, each a row a token.
template <class T>
struct Saved {
    T *qkv, *mixed, *y1, *hidden, *y2;
};

// A thread's working memory.
struct Scratch {
    Buffer qkv, mixed, y1, hidden, y2, x1, weights, keys, values;
    Buffer gradient1, gradient2, hidden_gradient, mixed_gradient, qkv_gradient, logit_gradient, left, right, wide;
};

template <class T>
class Layer {
  public:
    Layer(const Sizes& sizes, const float* const* parameters, const T* x, Saved<T> saved, Packed<T>& packed)
        : sizes(sizes), parameters(parameters), x(x), saved(saved), packed(packed) {}

    void forward(const Block& block, T* result) {
        const Index width = sizes.width, hidden = sizes.hidden, rows = block.rows;
        Saved<T> own = saved.qkv ? at(block) : Saved<T>{
            scratch.qkv.of<T>(rows * 3 * width), scratch.mixed.of<T>(rows * width), scratch.y1.of<T>(rows * width),
            scratch.hidden.of<T>(rows * hidden), scratch.y2.of<T>(rows * width)};
        const T* in = x + block.row * width;
        T* x1 = scratch.x1.of<T>(rows * width);

        const float* bias = get(QKV_BIAS, block);
        apply(in, QKV, block, [&](Index r, const float* values) {
            T* out = own.qkv + r * 3 * width;
            for (Index i = 0; i < 3 * width; i += LANES) store(out + i, load(values + i) + load(bias + i));
        });
        each_head(block, [&](Index row, Index n, Index head) {
            const T* qkv = own.qkv + row * 3 * width + head;
            const T* weights = attend(qkv, n);
            Word<T>* values = scratch.values.of<Word<T>>(packed_size<T>(n, sizes.head()));
            pack(qkv + 2 * width, 3 * width, n, sizes.head(), values);
            product(n, sizes.head(), words<T>(n), as_words(weights), round_up(n, LANES) / Words<T>::size, 1, values,
                    [&](Index r, const float* mixed) { copy(mixed, sizes.head(), own.mixed + (row + r) * width + head); });
        });
        residual(own.mixed, OUT, block, in, own.y1);
        for (Index r = 0; r < rows; ++r)
            normalize(moments(own.y1 + r * width, width), own.y1 + r * width, width, get(NORM1, block),
                      get(NORM1_BIAS, block), x1 + r * width);
        bias = get(EXPAND_BIAS, block);
        apply(x1, EXPAND, block, [&](Index r, const float* values) {
            T* out = own.hidden + r * hidden;
            for (Index i = 0; i < hidden; i += LANES) {
                const Floats sum = load(values + i) + load(bias + i);
                store(out + i, sum < 0 ? all(0) : sum);
            }
        });
        residual(own.hidden, CONTRACT, block, x1, own.y2);
        for (Index r = 0; r < rows; ++r)
            normalize(moments(own.y2 + r * width, width), own.y2 + r * width, width, get(NORM2, block),
                      get(NORM2_BIAS, block), result + (block.row + r) * width);
    }

    // `packed` holds the transposed weights here. Gradients of parameters are added, unless their pointers are null.
    void backward(const Block& block, const T* result_gradient, T* x_gradient, float* const* gradients) {
        const Index width = sizes.width, hidden = sizes.hidden, rows = block.rows;
        const Saved<T> own = at(block);
        const auto gradient = [&](int parameter) {
            return gradients ? gradients[parameter] + block.member * sizes.size(parameter) : nullptr;
        };
        T* y2 = scratch.gradient2.of<T>(rows * width);
        float* wide = scratch.wide.of<float>(width);
        for (Index r = 0; r < rows; ++r) {
            copy(result_gradient + (block.row + r) * width, width, wide);
            normalize_backward(moments(own.y2 + r * width, width), own.y2 + r * width, width, get(NORM2, block), wide,
                               gradient(NORM2), gradient(NORM2_BIAS), y2 + r * width);
        }
        T* h = scratch.hidden_gradient.of<T>(rows * hidden);
        apply_transposed(y2, CONTRACT, block, [&](Index r, const float* values) {
            for (Index i = 0; i < hidden; i += LANES)
                store(h + r * hidden + i, load(own.hidden + r * hidden + i) > 0 ? load(values + i) : all(0));
        });
        T *y1 = scratch.gradient1.of<T>(rows * width), *x1 = scratch.x1.of<T>(rows * width);
        apply_transposed(h, EXPAND, block, [&](Index r, float* values) {
            add(y2 + r * width, width, values);
            const T* row = own.y1 + r * width;
            const Moments own_moments = moments(row, width);
            normalize_backward(own_moments, row, width, get(NORM1, block), values, gradient(NORM1),
                               gradient(NORM1_BIAS), y1 + r * width);
            if (gradients) normalize(own_moments, row, width, get(NORM1, block), get(NORM1_BIAS, block), x1 + r * width);
        });
        T* mixed = scratch.mixed_gradient.of<T>(rows * width);
        apply_transposed(y1, OUT, block, [&](Index r, const float* values) { copy(values, width, mixed + r * width); });
        T* qkv = scratch.qkv_gradient.of<T>(rows * 3 * width);
        each_head(block, [&](Index row, Index n, Index head) {
            attend_backward(own.qkv + row * 3 * width + head, mixed + row * width + head, n,
                            qkv + row * 3 * width + head);
        });
        apply_transposed(qkv, QKV, block, [&](Index r, float* values) {
            add(y1 + r * width, width, values);
            copy(values, width, x_gradient + (block.row + r) * width);
        });
        if (!gradients) return;
        weigh(own.hidden, y2, CONTRACT, rows, gradient(CONTRACT), gradient(CONTRACT_BIAS));
        weigh(x1, h, EXPAND, rows, gradient(EXPAND), gradient(EXPAND_BIAS));
        weigh(own.mixed, y1, OUT, rows, gradient(OUT), gradient(OUT_BIAS));
        weigh(x + block.row * width, qkv, QKV, rows, gradient(QKV), gradient(QKV_BIAS));
    }

  private:
    const Sizes& sizes;
    const float* const* parameters;
    const T* x;
    Saved<T> saved;
    Packed<T>& packed;
    inline static thread_local Scratch scratch;

    const float* get(int parameter, const Block& block) const {
        return parameters[parameter] + block.member * sizes.size(parameter);
    }
    Saved<T> at(const Block& block) const {
        const Index start = block.row * sizes.width;
        return {saved.qkv + 3 * start, saved.mixed + start, saved.y1 + start,
                saved.hidden + block.row * sizes.hidden, saved.y2 + start};
    }

    template <class Finish>
    void apply(const T* in, int matrix, const Block& block, Finish&& finish) {
        const auto [k, n] = sizes.shape(matrix);
        product(block.rows, n, words<T>(k), as_words(in), words<T>(k), 1, packed.get(matrix, block.member), finish);
    }
    template <class Finish>
    void apply_transposed(const T* in, int matrix, const Block& block, Finish&& finish) {
        const auto [n, k] = sizes.shape(matrix);
        product(block.rows, n, words<T>(k), as_words(in), words<T>(k), 1, packed.get(matrix, block.member), finish);
    }
    void residual(const T* in, int matrix, const Block& block, const T* past, T* out) {
        const float* bias = get(matrix + 1, block);
        apply(in, matrix, block, [&](Index r, const float* values) {
            for (Index i = 0, at = r * sizes.width; i < sizes.width; i += LANES)
                store(out + at + i, load(values + i) + load(bias + i) + load(past + at + i));
        });
    }

    // Calls `work(first row, rows, first column of the head)` for every sequence and head of a block.
    template <class Work>
    void each_head(const Block& block, Work&& work) {
        for (Index s = block.first; s < block.last; ++s)
            for (Index head = 0; head < sizes.width; head += sizes.head())
                work(sizes.starts[s] - sizes.starts[block.first], sizes.starts[s + 1] - sizes.starts[s], head);
    }

    // Attention weights (n rows, padded with zeros) of a head, whose queries lie at `qkv`.
    const T* attend(const T* qkv, Index n) {
        const Index ld = round_up(n, LANES), head = sizes.head(), step = 3 * sizes.width;
        T* weights = scratch.weights.of<T>(n * ld);
        Word<T>* keys = scratch.keys.of<Word<T>>(packed_size<T>(head, n));
        pack_transposed(qkv + sizes.width, step, head, n, keys);
        const float scale = 1 / std::sqrt(float(head));
        product(n, n, words<T>(head), as_words(qkv), words<T>(step), 1, keys,
                [&](Index r, float* logits) { softmax(logits, n, scale, weights + r * ld); });
        return weights;
    }

    void attend_backward(const T* qkv, const T* mixed_gradient, Index n, T* qkv_gradient) {
        const Index width = sizes.width, ld = round_up(n, LANES), head = sizes.head(), step = 3 * width;
        const float scale = 1 / std::sqrt(float(head));
        const T* weights = attend(qkv, n);
        T* logits = scratch.logit_gradient.of<T>(n * ld);
        Word<T>* values = scratch.values.of<Word<T>>(packed_size<T>(head, n));
        pack_transposed(qkv + 2 * width, step, head, n, values);
        product(n, n, words<T>(head), as_words(mixed_gradient), words<T>(width), 1, values,
                [&](Index r, const float* g) {
            softmax_backward(weights + r * ld, ld, scale, g, logits + r * ld);
        });
        Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(n, head));
        const auto finish = [&](T* out) {
            return [=](Index r, const float* g) { copy(g, head, out + r * step); };
        };
        pack(qkv + width, step, n, head, right);
        product(n, head, words<T>(n), as_words(logits), words<T>(ld), 1, right, finish(qkv_gradient));
        Word<T>* left = scratch.left.of<Word<T>>(words<T>(n) * n);
        pack(qkv, step, n, head, right);
        interleave(logits, ld, n, n, left, n);
        product(n, head, words<T>(n), left, 1, n, right, finish(qkv_gradient + width));
        pack(mixed_gradient, width, n, head, right);
        interleave(weights, ld, n, n, left, n);
        product(n, head, words<T>(n), left, 1, n, right, finish(qkv_gradient + 2 * width));
    }

    // Adds in^T g to a matrix' gradient, and the sum of g's rows to that of its bias.
    void weigh(const T* in, const T* g, int matrix, Index rows, float* gradient, float* bias_gradient) {
        const auto [m, n] = sizes.shape(matrix);
        Word<T>* left = scratch.left.of<Word<T>>(words<T>(rows) * m);
        Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(rows, n));
        interleave(in, m, rows, m, left, m);
        pack(g, n, rows, n, right);
        product(m, n, words<T>(rows), left, 1, m, right,
                [&, n = n](Index r, const float* values) { add(values, n, gradient + r * n); });
        for (Index r = 0; r < rows; ++r) add(g + r * n, n, bias_gradient);
    }
};

template <class T>
void forward(const Sizes& sizes, int threads, const float* const* parameters, const T* x, T* const* saved, T* result) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;  // The threads use the caller's.
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, false);
        Layer<T> layer(sizes, parameters, x, {saved[0], saved[1], saved[2], saved[3], saved[4]}, packed);
        for_own_blocks(sizes, [&](const Block& block) { layer.forward(block, result); });
    }
}

template <class T>
void backward(const Sizes& sizes, int threads, const float* const* parameters, const T* x, T* const* saved,
              const T* result_gradient, T* x_gradient, float* const* gradients) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, true);
        Layer<T> layer(sizes, parameters, x, {saved[0], saved[1], saved[2], saved[3], saved[4]}, packed);
        float* const* mine = gradients ? gradients + omp_get_thread_num() * PARAMETERS : nullptr;
        for_own_blocks(sizes, [&](const Block& block) { layer.backward(block, result_gradient, x_gradient, mine); });
    }
}

}  // namespace

extern "C" {

// sizes: members, sequences, width, heads, hidden; starts as in `Sizes`. Heads and hidden are multiples of 16 wide.
#define DEFINE(NAME, T)                                                                                                \
    void layer_forward_##NAME(const std::int64_t* s, const std::int64_t* starts, int threads,                          \
                              const float* const* parameters, const T* x, T* const* saved, T* result) {                \
        forward<T>({s[0], s[1], s[2], s[3], s[4], starts}, threads, parameters, x, saved, result);                     \
    }                                                                                                                  \
    void layer_backward_##NAME(const std::int64_t* s, const std::int64_t* starts, int threads,                         \
                               const float* const* parameters, const T* x, T* const* saved, const T* result_gradient,  \
                               T* x_gradient, float* const* gradients) {                                               \
        backward<T>({s[0], s[1], s[2], s[3], s[4], starts}, threads, parameters, x, saved, result_gradient,            \
                    x_gradient, gradients);                                                                            \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
