// What happens to single rows between products. Rows are whole vectors long: widths are multiples of LANES, and rows of
// attention weights are padded.

#pragma once

#include <cmath>
#include <limits>

#include "product.h"

constexpr float EPSILON = 1e-5f;

// e^x for x <= 0 (after Cephes' expf).
inline Floats exponential(Floats x) {
    x = x < -87.0f ? all(-87.0f) : x;
    const Floats n = (x * 1.44269504f + 12582912.0f) - 12582912.0f;  // Rounds.
    const Floats r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
    Floats p = all(1.9875691500e-4f);
    for (float c : {1.3981999507e-3f, 8.3334519073e-3f, 4.1665795894e-2f, 1.6666665459e-1f, 5.0000001201e-1f}) p = p * r + c;
    return (p * r * r + r + 1.0f) * (Floats)((__builtin_convertvector(n, Integers) + 127) << 23);
}

// The first n numbers of x, and `other` behind them. Tiny numbers in place of zeros would cost hundreds of cycles.
inline Floats used(Floats x, Index n, float other) { return lanes() < std::int32_t(std::min(n, LANES)) ? x : all(other); }

// Writes softmax(scale * logits), padded with zeros; overwrites the logits.
template <class T>
void softmax(float* logits, Index n, float scale, T* out) {
    const Index padded = round_up(n, LANES);
    std::fill(logits + n, logits + padded, -std::numeric_limits<float>::infinity());
    Floats most = load(logits), sum = {};
    for (Index i = LANES; i < padded; i += LANES) most = load(logits + i) > most ? load(logits + i) : most;
    const float top = greatest(most);
    for (Index i = 0; i < padded; i += LANES) {
        const Floats power = used(exponential((load(logits + i) - top) * scale), n - i, 0);
        sum += power;
        store(logits + i, power);
    }
    const float share = 1 / total(sum);
    for (Index i = 0; i < padded; i += LANES) store(out + i, load(logits + i) * share);
}

// The same of up to LANES numbers: x, of which those from n on do not count.
template <class T>
void softmax_short(Floats x, Index n, T* out) {
    const Floats top = all(greatest(used(x, n, -std::numeric_limits<float>::infinity()))), power = used(exponential(x - top), n, 0);
    store(out, power * (1 / total(power)));
}

// Gradient of the logits from that of the attention weights.
template <class T>
void softmax_backward(const T* weights, Index padded, float scale, const float* gradient, T* out) {
    Floats sum = {};
    for (Index i = 0; i < padded; i += LANES) sum += load(weights + i) * load(gradient + i);
    const float mean = total(sum);
    for (Index i = 0; i < padded; i += LANES) store(out + i, load(weights + i) * (load(gradient + i) - mean) * scale);
}

inline float load_first(const float* x) { return *x; }
inline float load_first(const bfloat16* x) {
    const std::uint32_t bits = std::uint32_t(x->bits) << 16;
    float found;
    std::memcpy(&found, &bits, sizeof(found));
    return found;
}

struct Moments {
    float mean, scale;
};

template <class T>
Moments moments(const T* y, Index n) {
    const float near = load_first(y);  // Differences from a number of the row lose nothing where all are alike.
    Floats sum = {}, squares = {};
    for (Index i = 0; i < n; i += LANES) {
        const Floats x = load(y + i) - near;
        sum += x;
        squares += x * x;
    }
    const float shift = total(sum) / n, variance = total(squares) / n - shift * shift;
    return {near + shift, 1 / std::sqrt(std::max(variance, 0.0f) + EPSILON)};
}

template <class T>
void normalize(Moments moments, const T* y, Index n, const float* weight, const float* bias, T* out) {
    const auto [mean, scale] = moments;
    for (Index i = 0; i < n; i += LANES)
        store(out + i, (load(y + i) - mean) * scale * load(weight + i) + load(bias + i));
}

// Gradient of y from that of norm(y); adds the gradients of weight and bias, unless they are null.
template <class T>
void normalize_backward(Moments moments, const T* y, Index n, const float* weight, const float* gradient,
                        float* weight_gradient, float* bias_gradient, T* out) {
    const auto [mean, scale] = moments;
    Floats sum = {}, along = {};
    for (Index i = 0; i < n; i += LANES) {
        const Floats g = load(gradient + i) * load(weight + i);
        sum += g;
        along += g * (load(y + i) - mean);
    }
    const float level = total(sum) / n, slope = total(along) * scale * scale / n;
    for (Index i = 0; i < n; i += LANES)
        store(out + i, (load(gradient + i) * load(weight + i) - level - (load(y + i) - mean) * slope) * scale);
    if (!weight_gradient) return;
    for (Index i = 0; i < n; i += LANES) {
        const Floats g = load(gradient + i);
        store(weight_gradient + i, load(weight_gradient + i) + g * (load(y + i) - mean) * scale);
        store(bias_gradient + i, load(bias_gradient + i) + g);
    }
}

template <class T>
void add(const T* x, Index n, float* sum) {
    for (Index i = 0; i < n; i += LANES) store(sum + i, load(sum + i) + load(x + i));
}

template <class From, class To>
void copy(const From* x, Index n, To* out) {
    for (Index i = 0; i < n; i += LANES) store(out + i, load(x + i));
}

// As `copy`, of a row of any length, which is filled up with zeros to a whole number of vectors.
template <class To>
void copy_part(const float* x, Index n, To* out) {
    Index i = 0;
    for (; i + LANES <= n; i += LANES) store(out + i, load(x + i));
    if (i < n) store(out + i, load_part<Floats>(x + i, n - i));
}
