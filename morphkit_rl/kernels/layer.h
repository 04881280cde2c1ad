// What transformer layers over sequences of different lengths share: whose parts are products of rows with four matrices,
// and attention within each sequence.
//
//     q, k, v = x W_qkv + b_qkv        m = softmax(q k^T / sqrt(d_head) + bias) v, head by head, sequence by sequence
//     m W_out + b_out                  h = relu(x W_expand + b_expand)             h W_contract + b_contract
//
// Rows are tokens. Each thread takes whole sequences and carries a block of them through a layer, so that what lies
// between two products never leaves its cache. Sums are float32. Members are independent layers with rows of their own.

#pragma once

#include <cmath>
#include <omp.h>

#include "rows.h"

namespace {

constexpr Index BLOCK_ROWS = 128;  // At least so many rows a block, if there are: enough for products to pay.

enum { QKV, QKV_BIAS, OUT, OUT_BIAS, EXPAND, EXPAND_BIAS, CONTRACT, CONTRACT_BIAS, FURTHER };

struct Sizes {
    Index members, sequences, width, heads, hidden;
    const std::int64_t* starts;  // Row of each sequence's first token, and the number of rows.

    Index rows() const { return starts[sequences]; }
    Index head() const { return width / heads; }

    // Rows and columns of a parameter; biases have one row, and so have norms, which may come from FURTHER on.
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

// A thread's working memory for attention and gradients of matrices.
struct SharedScratch {
    Buffer weights, keys, values, logit_gradient, left, right;
};

// Added to attention logits: a number a head and kind of relation between two tokens of a sequence.
struct Relations {
    Index kinds = 0, period = 1;     // Sequences repeat after `period`.
    const std::int64_t* firsts = nullptr;  // Place of a sequence's relations in `kind`.
    const std::int32_t* kind = nullptr;    // (tokens, tokens) of each sequence.
    const float* bias = nullptr;           // (heads, kinds)

    const std::int32_t* of(Index sequence) const { return kinds ? kind + firsts[sequence % period] : nullptr; }
};

// The parts of a layer.
template <class T>
class Parts {
  public:
    Parts(const Sizes& sizes, const float* const* parameters, Packed<T>& packed, Relations relations = {})
        : sizes(sizes), parameters(parameters), packed(packed), relations(relations) {}

  protected:
    const Sizes& sizes;
    const float* const* parameters;
    Packed<T>& packed;
    const Relations relations;
    inline static thread_local SharedScratch shared;

    const float* get(int parameter, const Block& block) const {
        return parameters[parameter] + block.member * sizes.size(parameter);
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

    // Calls `work(sequence, first row, rows, first column of the head)` for every sequence and head of a block.
    template <class Work>
    void each_head(const Block& block, Work&& work) {
        for (Index s = block.first; s < block.last; ++s)
            for (Index head = 0; head < sizes.width; head += sizes.head())
                work(s, sizes.starts[s] - sizes.starts[block.first], sizes.starts[s + 1] - sizes.starts[s], head);
    }

    // Attends in all sequences of a block.
    void mix(const Block& block, const T* qkv, T* mixed) {
        const Index width = sizes.width;
        each_head(block, [&](Index sequence, Index row, Index n, Index head) {
            const T* own = qkv + row * 3 * width + head;
            const T* weights = attend(own, n, sequence, head);
            Word<T>* values = shared.values.of<Word<T>>(packed_size<T>(n, sizes.head()));
            pack(own + 2 * width, 3 * width, n, sizes.head(), values);
            product(n, sizes.head(), words<T>(n), as_words(weights), round_up(n, LANES) / Words<T>::size, 1, values,
                    [&](Index r, const float* out) { copy(out, sizes.head(), mixed + (row + r) * width + head); });
        });
    }
    // The way back; `bias_gradient` is that of the relations' bias, or null.
    void mix_backward(const Block& block, const T* qkv, const T* mixed_gradient, T* qkv_gradient, float* bias_gradient) {
        const Index width = sizes.width;
        each_head(block, [&](Index sequence, Index row, Index n, Index head) {
            attend_backward(qkv + row * 3 * width + head, mixed_gradient + row * width + head, n, sequence, head,
                            qkv_gradient + row * 3 * width + head, bias_gradient);
        });
    }

    // Attention weights (n rows, padded with zeros) of a head, whose queries lie at `qkv`.
    const T* attend(const T* qkv, Index n, Index sequence, Index first) {
        const Index ld = round_up(n, LANES), head = sizes.head(), step = 3 * sizes.width;
        T* weights = shared.weights.of<T>(n * ld);
        Word<T>* keys = shared.keys.of<Word<T>>(packed_size<T>(head, n));
        pack_transposed(qkv + sizes.width, step, head, n, keys);
        const float scale = 1 / std::sqrt(float(head));
        const float* bias = relations.bias + first / head * relations.kinds;
        const bool small = relations.kinds && n <= LANES && relations.kinds <= LANES;
        const Floats biases = load_part<Floats>(bias, small ? relations.kinds : 0);
        product(n, n, words<T>(head), as_words(qkv), words<T>(step), 1, keys,
                [&](Index r, float* logits) {
            if (!relations.kinds) return softmax(logits, n, scale, weights + r * ld);
            const std::int32_t* kind = relations.of(sequence) + r * n;
            if (small) {
                const Floats added = __builtin_shuffle(biases, load_part<Integers>(kind, n));
                return softmax_short(load(logits) * scale + added, n, weights + r * ld);
            }
            for (Index i = 0; i < n; ++i) logits[i] = logits[i] * scale + bias[kind[i]];
            softmax(logits, n, 1.0f, weights + r * ld);
        });
        return weights;
    }

    void attend_backward(const T* qkv, const T* mixed_gradient, Index n, Index sequence, Index first, T* qkv_gradient,
                         float* bias_gradient) {
        const Index width = sizes.width, ld = round_up(n, LANES), head = sizes.head(), step = 3 * width;
        const float scale = 1 / std::sqrt(float(head));
        const T* weights = attend(qkv, n, sequence, first);
        T* logits = shared.logit_gradient.of<T>(n * ld);
        Word<T>* values = shared.values.of<Word<T>>(packed_size<T>(head, n));
        pack_transposed(qkv + 2 * width, step, head, n, values);
        product(n, n, words<T>(head), as_words(mixed_gradient), words<T>(width), 1, values,
                [&](Index r, const float* g) {
            softmax_backward(weights + r * ld, ld, scale, g, logits + r * ld);
            if (!relations.kinds || !bias_gradient) return;
            const std::int32_t* kind = relations.of(sequence) + r * n;
            float row[LANES];
            for (Index i = 0; i < n; i += LANES) {
                copy(logits + r * ld + i, LANES, row);
                for (Index j = i; j < std::min(n, i + LANES); ++j)
                    bias_gradient[first / head * relations.kinds + kind[j]] += row[j - i] / scale;
            }
        });
        Word<T>* right = shared.right.of<Word<T>>(packed_size<T>(n, head));
        const auto finish = [&](T* out) {
            return [=](Index r, const float* g) { copy(g, head, out + r * step); };
        };
        pack(qkv + width, step, n, head, right);
        product(n, head, words<T>(n), as_words(logits), words<T>(ld), 1, right, finish(qkv_gradient));
        pack(qkv, step, n, head, right);
        Left<T> left = transpose_left(logits, ld, n, n, shared.left);
        product(n, head, n, left, right, finish(qkv_gradient + width));
        pack(mixed_gradient, width, n, head, right);
        left = transpose_left(weights, ld, n, n, shared.left);
        product(n, head, n, left, right, finish(qkv_gradient + 2 * width));
    }

    // Adds in^T g to a matrix' gradient, and the sum of g's rows to that of its bias.
    void weigh(const T* in, const T* g, int matrix, Index rows, float* gradient, float* bias_gradient) {
        const auto [m, n] = sizes.shape(matrix);
        Word<T>* right = shared.right.of<Word<T>>(packed_size<T>(rows, n));
        const Left<T> left = transpose_left(in, m, rows, m, shared.left);
        pack(g, n, rows, n, right);
        product(m, n, rows, left, right,
                [&, n = n](Index r, const float* values) { add(values, n, gradient + r * n); });
        for (Index r = 0; r < rows; ++r) add(g + r * n, n, bias_gradient);
    }
};

}  // namespace
