// A pre-norm transformer layer whose attention knows how tokens are related, forward and backward:
//
//     qkv = norm(x) W_qkv + b_qkv        m = attention(qkv), with a bias by head and relation of two tokens
//     x1 = m W_out + b_out + x           h = relu(norm(x1) W_expand + b_expand)      result = h W_contract + b_contract + x1
//
// Norms have no scale and shift. Attention weights and norms are computed again on the way back. See layer.h.

#include "layer.h"

namespace {

enum { RELATION_BIAS = FURTHER, PARAMETERS };

// What the way back needs of the way forward, each a row a token.
template <class T>
struct Saved {
    T *qkv, *mixed, *x1, *hidden;
};

// A thread's working memory.
struct Scratch {
    Buffer qkv, mixed, x1, hidden, normed, ones, zeros;
    Buffer gradient, x1_gradient, hidden_gradient, mixed_gradient, qkv_gradient;
};

template <class T>
class Layer : Parts<T> {
  public:
    Layer(const Sizes& sizes, const float* const* parameters, const T* x, Saved<T> saved, Packed<T>& packed,
          Relations relations)
        : Parts<T>(sizes, parameters, packed, relations), x(x), saved(saved) {
        ones = scratch.ones.of<float>(sizes.width);
        zeros = scratch.zeros.of<float>(sizes.width);
        std::fill(ones, ones + sizes.width, 1.0f);
        std::fill(zeros, zeros + sizes.width, 0.0f);
    }

    void forward(const Block& block, T* result) {
        const Index width = sizes.width, hidden = sizes.hidden, rows = block.rows;
        Saved<T> own = saved.qkv ? at(block) : Saved<T>{
            scratch.qkv.of<T>(rows * 3 * width), scratch.mixed.of<T>(rows * width), scratch.x1.of<T>(rows * width),
            scratch.hidden.of<T>(rows * hidden)};
        const T* in = x + block.row * width;
        const float* bias = get(QKV_BIAS, block);
        apply(norm(in, rows), QKV, block, [&](Index r, const float* values) {
            T* out = own.qkv + r * 3 * width;
            for (Index i = 0; i < 3 * width; i += LANES) store(out + i, load(values + i) + load(bias + i));
        });
        mix(block, own.qkv, own.mixed);
        residual(own.mixed, OUT, block, in, own.x1);
        bias = get(EXPAND_BIAS, block);
        apply(norm(own.x1, rows), EXPAND, block, [&](Index r, const float* values) {
            T* out = own.hidden + r * hidden;
            for (Index i = 0; i < hidden; i += LANES) {
                const Floats sum = load(values + i) + load(bias + i);
                store(out + i, sum < 0 ? all(0) : sum);
            }
        });
        residual(own.hidden, CONTRACT, block, own.x1, result + block.row * width);
    }

    // `packed` holds the transposed weights here. Gradients of parameters are added, unless their pointers are null.
    void backward(const Block& block, const T* result_gradient, T* x_gradient, float* const* gradients) {
        const Index width = sizes.width, hidden = sizes.hidden, rows = block.rows;
        const Saved<T> own = at(block);
        const T *in = x + block.row * width, *g = result_gradient + block.row * width;
        const auto gradient = [&](int parameter) {
            return gradients ? gradients[parameter] + block.member * sizes.size(parameter) : nullptr;
        };
        T* h = scratch.hidden_gradient.of<T>(rows * hidden);
        apply_transposed(g, CONTRACT, block, [&](Index r, const float* values) {
            for (Index i = 0; i < hidden; i += LANES)
                store(h + r * hidden + i, load(own.hidden + r * hidden + i) > 0 ? load(values + i) : all(0));
        });
        T* x1 = scratch.x1_gradient.of<T>(rows * width);
        apply_transposed(h, EXPAND, block, [&](Index r, float* values) { pass(own.x1 + r * width, values, g + r * width, x1 + r * width); });
        if (gradients) {
            weigh(own.hidden, g, CONTRACT, rows, gradient(CONTRACT), gradient(CONTRACT_BIAS));
            weigh(norm(own.x1, rows), h, EXPAND, rows, gradient(EXPAND), gradient(EXPAND_BIAS));
        }
        T *mixed = scratch.mixed_gradient.of<T>(rows * width), *qkv = scratch.qkv_gradient.of<T>(rows * 3 * width);
        apply_transposed(x1, OUT, block, [&](Index r, const float* values) { copy(values, width, mixed + r * width); });
        float* bias_gradient = gradients ? gradients[RELATION_BIAS] + block.member * sizes.heads * relations.kinds : nullptr;
        mix_backward(block, own.qkv, mixed, qkv, bias_gradient);
        apply_transposed(qkv, QKV, block, [&](Index r, float* values) {
            pass(in + r * width, values, x1 + r * width, x_gradient + (block.row + r) * width);
        });
        if (!gradients) return;
        weigh(own.mixed, x1, OUT, rows, gradient(OUT), gradient(OUT_BIAS));
        weigh(norm(in, rows), qkv, QKV, rows, gradient(QKV), gradient(QKV_BIAS));
    }

  private:
    using Parts<T>::sizes, Parts<T>::get, Parts<T>::apply, Parts<T>::apply_transposed, Parts<T>::residual, Parts<T>::mix,
        Parts<T>::mix_backward, Parts<T>::weigh, Parts<T>::relations;
    const T* x;
    Saved<T> saved;
    float *ones, *zeros;
    inline static thread_local Scratch scratch;

    Saved<T> at(const Block& block) const {
        const Index start = block.row * sizes.width;
        return {saved.qkv + 3 * start, saved.mixed + start, saved.x1 + start, saved.hidden + block.row * sizes.hidden};
    }
    const T* norm(const T* in, Index rows) {
        const Index width = sizes.width;
        T* out = scratch.normed.of<T>(rows * width);
        for (Index r = 0; r < rows; ++r)
            normalize(moments(in + r * width, width), in + r * width, width, ones, zeros, out + r * width);
        return out;
    }
    // From the gradient of norm(y) to that of y, to which `past` is added.
    void pass(const T* y, float* normed_gradient, const T* past, T* out) {
        normalize_backward<T>(moments(y, sizes.width), y, sizes.width, ones, normed_gradient, nullptr, nullptr, out);
        for (Index i = 0; i < sizes.width; i += LANES) store(out + i, load(out + i) + load(past + i));
    }
};

Relations of_member(Relations relations, const float* const* parameters, const Sizes& sizes, Index member) {
    relations.bias = parameters[RELATION_BIAS] + member * sizes.heads * relations.kinds;
    return relations;
}

template <class T>
void forward(const Sizes& sizes, int threads, const float* const* parameters, Relations relations, const T* x,
             T* const* saved, T* result) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;  // The threads use the caller's.
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, false);
        for_own_blocks(sizes, [&](const Block& block) {
            Layer<T> layer(sizes, parameters, x, {saved[0], saved[1], saved[2], saved[3]}, packed,
                           of_member(relations, parameters, sizes, block.member));
            layer.forward(block, result);
        });
    }
}

template <class T>
void backward(const Sizes& sizes, int threads, const float* const* parameters, Relations relations, const T* x,
              T* const* saved, const T* result_gradient, T* x_gradient, float* const* gradients) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;
#pragma omp parallel num_threads(threads)
    {
        packed.fill(sizes, parameters, true);
        float* const* mine = gradients ? gradients + omp_get_thread_num() * PARAMETERS : nullptr;
        for_own_blocks(sizes, [&](const Block& block) {
            Layer<T> layer(sizes, parameters, x, {saved[0], saved[1], saved[2], saved[3]}, packed,
                           of_member(relations, parameters, sizes, block.member));
            layer.backward(block, result_gradient, x_gradient, mine);
        });
    }
}

}  // namespace

extern "C" {

// s: members, sequences, width, heads, hidden, kinds of relations, sequences in a sample; starts as in `Sizes`, firsts and
// kinds as in `Relations`. Heads and hidden are multiples of 16 wide.
#define DEFINE(NAME, T)                                                                                                \
    void limb_layer_forward_##NAME(const std::int64_t* s, const std::int64_t* starts, const std::int64_t* firsts,      \
                                   const std::int32_t* kinds, int threads, const float* const* parameters, const T* x, \
                                   T* const* saved, T* result) {                                                       \
        forward<T>({s[0], s[1], s[2], s[3], s[4], starts}, threads, parameters, {s[5], s[6], firsts, kinds}, x, saved, \
                   result);                                                                                            \
    }                                                                                                                  \
    void limb_layer_backward_##NAME(const std::int64_t* s, const std::int64_t* starts, const std::int64_t* firsts,     \
                                    const std::int32_t* kinds, int threads, const float* const* parameters,            \
                                    const T* x, T* const* saved, const T* result_gradient, T* x_gradient,              \
                                    float* const* gradients) {                                                         \
        backward<T>({s[0], s[1], s[2], s[3], s[4], starts}, threads, parameters, {s[5], s[6], firsts, kinds}, x,       \
                    saved, result_gradient, x_gradient, gradients);                                                    \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
