// A post-norm transformer encoder layer, forward and backward:
//
//     q, k, v = x W_qkv + b_qkv                  m = softmax(q k^T / sqrt(d_head)) v, head by head, sequence by sequence
//     y1 = m W_out + b_out + x                   x1 = norm1(y1)
//     h = relu(x1 W_expand + b_expand)           y2 = h W_contract + b_contract + x1        result = norm2(y2)
//
// Rows are tokens; sequences of them attend among themselves. Each thread takes whole sequences and carries a block of
// them through the layer, so that what lies between two products never leaves its cache. Sums are float32. Attention
// weights are computed again on the way back. Members are independent layers with rows of their own.

#include "layer.h"

namespace {

enum { NORM1 = FURTHER, NORM1_BIAS, NORM2, NORM2_BIAS, PARAMETERS };

// What the way back needs of the way forward, each a row a token.
template <class T>
struct Saved {
    T *qkv, *mixed, *y1, *hidden, *y2;
};

// A thread's working memory.
struct Scratch {
    Buffer qkv, mixed, y1, hidden, y2, x1;
    Buffer gradient1, gradient2, hidden_gradient, mixed_gradient, qkv_gradient, wide;
};

template <class T>
class Layer : Parts<T> {
  public:
    Layer(const Sizes& sizes, const float* const* parameters, const T* x, Saved<T> saved, Packed<T>& packed)
        : Parts<T>(sizes, parameters, packed), x(x), saved(saved) {}

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
        mix(block, own.qkv, own.mixed);
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
        mix_backward(block, own.qkv, mixed, qkv, nullptr);
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
    using Parts<T>::sizes, Parts<T>::get, Parts<T>::apply, Parts<T>::apply_transposed, Parts<T>::residual, Parts<T>::mix,
        Parts<T>::mix_backward, Parts<T>::weigh;
    const T* x;
    Saved<T> saved;
    inline static thread_local Scratch scratch;

    Saved<T> at(const Block& block) const {
        const Index start = block.row * sizes.width;
        return {saved.qkv + 3 * start, saved.mixed + start, saved.y1 + start,
                saved.hidden + block.row * sizes.hidden, saved.y2 + start};
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
