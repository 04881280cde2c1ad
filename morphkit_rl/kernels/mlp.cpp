// A perceptron with two hidden relu layers, forward and backward:
//
//     h1 = relu(x W1 + b1)        h2 = relu(h1 W2 + b2)        result = h2 W3 + b3
//
// Each thread carries blocks of rows through all layers. Rows are kept as long as the next multiple of LANES, filled up
// with zeros, so that widths are free. x and the result are float32; factors are as precise as said. Members are
// independent networks with rows of their own, or, with `shared`, with the same rows.

#include <omp.h>

#include "rows.h"

namespace {

constexpr Index BLOCK_ROWS = 192, LAYERS = 3;  // At most so many rows a block.

struct Sizes {
    Index members, rows, shared, widths[LAYERS + 1];

    Index padded(Index layer) const { return round_up(widths[layer], LANES); }
};

// Weights and biases of all members, in panels, filled up with zeros.
template <class T>
class Packed {
  public:
    // To be called by all threads of a parallel region.
    void fill(const Sizes& sizes, const float* const* parameters, bool transposed) {
#pragma omp single
        for (Index layer = 0; layer < LAYERS; ++layer) {
            const Index k = sizes.padded(layer + transposed), n = sizes.padded(layer + !transposed);
            stride_[layer] = packed_size<T>(k, n);
            weights_[layer].template of<Word<T>>(stride_[layer] * sizes.members);
            biases_[layer].template of<float>(sizes.padded(layer + 1) * sizes.members);
        }
#pragma omp for schedule(dynamic)
        for (Index part = 0; part < LAYERS * sizes.members; ++part) {
            const Index layer = part % LAYERS, member = part / LAYERS, k = sizes.widths[layer],
                        n = sizes.widths[layer + 1], rows = sizes.padded(layer), columns = sizes.padded(layer + 1);
            thread_local Buffer buffer;
            T* narrowed = buffer.of<T>(rows * columns);
            std::fill(narrowed, narrowed + rows * columns, T());
            for (Index i = 0; i < k; ++i)
                copy_part(parameters[2 * layer] + (member * k + i) * n, n, narrowed + i * columns);
            Word<T>* out = weights_[layer].template of<Word<T>>(0) + member * stride_[layer];
            transposed ? pack_transposed(narrowed, columns, columns, rows, out) : pack(narrowed, columns, rows, columns, out);
            float* bias = biases_[layer].template of<float>(0) + member * columns;
            std::fill(std::copy_n(parameters[2 * layer + 1] + member * n, n, bias), bias + columns, 0.0f);
        }
    }
    const Word<T>* weight(Index layer, Index member) {
        return weights_[layer].template of<Word<T>>(0) + member * stride_[layer];
    }
    const float* bias(const Sizes& sizes, Index layer, Index member) {
        return biases_[layer].template of<float>(0) + member * sizes.padded(layer + 1);
    }

  private:
    Buffer weights_[LAYERS], biases_[LAYERS];
    Index stride_[LAYERS];
};

// A thread's working memory: rows of each layer, and their gradients.
struct Scratch {
    Buffer rows[LAYERS + 1], gradients[LAYERS + 1], left, right;
};

struct Block {
    Index member, row, rows;
};

template <class T>
class Network {
  public:
    Network(const Sizes& sizes, const float* x, Packed<T>& packed) : sizes(sizes), x(x), packed(packed) {}

    // Writes hidden layers to `saved`, unless that is null.
    void forward(const Block& block, T* const* saved, float* result) {
        T* in = read(x + (sizes.shared ? 0 : block.member * sizes.rows * sizes.widths[0]), block, 0, scratch.rows[0]);
        for (Index layer = 0; layer < LAYERS; ++layer) {
            const Index n = sizes.padded(layer + 1), first = block.member * sizes.rows + block.row;
            const bool last = layer + 1 == LAYERS;
            const float* bias = packed.bias(sizes, layer, block.member);
            T* out = last       ? nullptr
                     : saved[0] ? saved[layer] + first * n
                                : scratch.rows[layer + 1].template of<T>(block.rows * n);
            product(block.rows, n, words<T>(sizes.padded(layer)), as_words(in), words<T>(sizes.padded(layer)), 1,
                    packed.weight(layer, block.member), [&](Index r, float* values) {
                for (Index i = 0; i < n; i += LANES) {
                    const Floats sum = load(values + i) + load(bias + i);
                    last ? store(values + i, sum) : store(out + r * n + i, sum < 0 ? all(0) : sum);
                }
                if (last) std::copy_n(values, sizes.widths[LAYERS], result + (first + r) * sizes.widths[LAYERS]);
            });
            in = out;
        }
    }

    // `packed` holds the transposed weights here. Gradients of parameters are added, unless their pointers are null.
    void backward(const Block& block, T* const* saved, const float* result_gradient, float* x_gradient,
                  float* const* gradients) {
        const Index first = block.member * sizes.rows + block.row;
        T* g = read(result_gradient + block.member * sizes.rows * sizes.widths[LAYERS], block, LAYERS,
                    scratch.gradients[LAYERS]);
        for (Index layer = LAYERS; layer-- > 0;) {
            const Index k = sizes.padded(layer + 1), n = sizes.padded(layer);
            const T* in = layer ? saved[layer - 1] + first * n
                                : read(x + (sizes.shared ? 0 : block.member * sizes.rows * sizes.widths[0]), block, 0,
                                       scratch.rows[0]);
            if (gradients) weigh(in, g, layer, block, gradients);
            T* out = layer ? scratch.gradients[layer].template of<T>(block.rows * n) : nullptr;
            product(block.rows, n, words<T>(k), as_words(g), words<T>(k), 1, packed.weight(layer, block.member),
                    [&](Index r, const float* values) {
                if (layer)
                    for (Index i = 0; i < n; i += LANES)
                        store(out + r * n + i, load(in + r * n + i) > 0 ? load(values + i) : all(0));
                else
                    std::copy_n(values, sizes.widths[0], x_gradient + (first + r) * sizes.widths[0]);
            });
            g = out;
        }
    }

  private:
    const Sizes& sizes;
    const float* x;
    Packed<T>& packed;
    inline static thread_local Scratch scratch;

    // A block's rows of a member's float32 rows.
    T* read(const float* rows, const Block& block, Index layer, Buffer& buffer) {
        const Index width = sizes.widths[layer], padded = sizes.padded(layer);
        T* out = buffer.of<T>(block.rows * padded);
        for (Index r = 0; r < block.rows; ++r) copy_part(rows + (block.row + r) * width, width, out + r * padded);
        return out;
    }

    void weigh(const T* in, const T* g, Index layer, const Block& block, float* const* gradients) {
        const Index m = sizes.widths[layer], n = sizes.widths[layer + 1], width = sizes.padded(layer + 1);
        Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(block.rows, width));
        const Left<T> left = transpose_left(in, sizes.padded(layer), block.rows, m, scratch.left);
        pack(g, width, block.rows, width, right);
        float* sum = gradients[2 * layer] + block.member * m * n;
        product(m, width, block.rows, left, right, [&](Index r, const float* values) {
#pragma omp simd
            for (Index i = 0; i < n; ++i) sum[r * n + i] += values[i];
        });
        float* wide = scratch.left.of<float>(width);
        std::fill(wide, wide + width, 0.0f);
        for (Index r = 0; r < block.rows; ++r) add(g + r * width, width, wide);
        for (Index i = 0; i < n; ++i) gradients[2 * layer + 1][block.member * n + i] += wide[i];
    }
};

// Calls `work` with the blocks of one of the threads that run this: always the same ones, so that sums are, too.
template <class Work>
void for_own_blocks(const Sizes& sizes, Work&& work) {
    const Index blocks = round_up((sizes.rows + BLOCK_ROWS - 1) / BLOCK_ROWS, omp_get_num_threads()),
                size = (sizes.rows + blocks - 1) / blocks;
#pragma omp for schedule(static)
    for (Index part = 0; part < sizes.members * blocks; ++part) {
        const Index row = part % blocks * size, rows = std::min(size, sizes.rows - row);
        if (rows > 0) work(Block{part / blocks, row, rows});
    }
}

template <class T>
void forward(const Sizes& sizes, int threads, const float* const* parameters, const float* x, T* const* saved,
             float* result) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;  // The threads use the caller's.
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, false);
        Network<T> network(sizes, x, packed);
        for_own_blocks(sizes, [&](const Block& block) { network.forward(block, saved, result); });
    }
}

template <class T>
void backward(const Sizes& sizes, int threads, const float* const* parameters, const float* x, T* const* saved,
              const float* result_gradient, float* x_gradient, float* const* gradients) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, true);
        Network<T> network(sizes, x, packed);
        float* const* mine = gradients ? gradients + omp_get_thread_num() * 2 * LAYERS : nullptr;
        for_own_blocks(sizes, [&](const Block& block) { network.backward(block, saved, result_gradient, x_gradient, mine); });
    }
}

}  // namespace

extern "C" {

// s: members, rows, shared, and the four widths.
#define DEFINE(NAME, T)                                                                                                \
    void mlp_forward_##NAME(const std::int64_t* s, int threads, const float* const* parameters, const float* x,        \
                            T* const* saved, float* result) {                                                          \
        forward<T>({s[0], s[1], s[2], {s[3], s[4], s[5], s[6]}}, threads, parameters, x, saved, result);               \
    }                                                                                                                  \
    void mlp_backward_##NAME(const std::int64_t* s, int threads, const float* const* parameters, const float* x,       \
                             T* const* saved, const float* gradient, float* x_gradient, float* const* gradients) {     \
        backward<T>({s[0], s[1], s[2], {s[3], s[4], s[5], s[6]}}, threads, parameters, x, saved, gradient,             \
                    x_gradient, gradients);                                                                            \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
