// Matrix products of blocks that fit into a core's cache, in float32 or bfloat16 with float32 sums. See packing.h.

#pragma once

#include <type_traits>

#include "tiles.h"

inline Floats multiply_add(Floats sum, float a, const float* b) { return sum + a * *reinterpret_cast<const Floats*>(b); }
#ifdef __AVX512BF16__
inline Floats multiply_add(Floats sum, std::uint32_t a, const std::uint32_t* b) {
    return (Floats)_mm512_dpbf16_ps((__m512)sum, (__m512bh)_mm512_set1_epi32(int(a)), (__m512bh)_mm512_load_si512(b));
}
#endif

// c (M rows, V vectors) = a b over k words; a's words lie `row` apart from row to row, `step` along the inner axis.
template <class W, int M, int V>
void tile(Index k, const W* __restrict a, Index row, Index step, const W* __restrict b, float* __restrict c, Index ld) {
    Floats sum[M][V] = {};
    for (Index i = 0; i < k; ++i, a += step, b += PANEL)
#pragma GCC unroll 8
        for (int m = 0; m < M; ++m)
#pragma GCC unroll 8
            for (int v = 0; v < V; ++v) sum[m][v] = multiply_add(sum[m][v], a[m * row], b + v * LANES);
#pragma GCC unroll 8
    for (int m = 0; m < M; ++m)
#pragma GCC unroll 8
        for (int v = 0; v < V; ++v) *reinterpret_cast<Floats*>(c + m * ld + v * LANES) = sum[m][v];
}

template <class W>
using Tile = void (*)(Index, const W*, Index, Index, const W*, float*, Index);

template <class W, int... I>
Tile<W> choose_tile(Index rows, Index vectors, std::integer_sequence<int, I...>) {
    static constexpr Tile<W> tiles[] = {tile<W, I / TILE_VECTORS + 1, I % TILE_VECTORS + 1>...};
    return tiles[(rows - 1) * TILE_VECTORS + vectors - 1];
}

// Gives each row of a b (m rows, n columns, k words) to `finish(row, values)`, as soon as it is there.
template <class W, class Finish>
void product(Index m, Index n, Index k, const W* a, Index row, Index step, const W* b, Finish&& finish) {
#ifdef TILES
    if constexpr (std::is_same_v<W, Word<bfloat16>>)
        if (step == 1 && m >= tiles::SIZE && k >= tiles::SIZE && tiles::granted())
            return tiles::product(m, n, k, a, row, b, finish);
#endif
    thread_local Buffer buffer;
    const Index ld = round_up(n, LANES);
    float* c = buffer.of<float>(TILE_ROWS * ld);
    for (Index i = 0; i < m; i += TILE_ROWS) {
        const Index rows = std::min(TILE_ROWS, m - i);
        for (Index j = 0; j < n; j += PANEL) {
            const Index vectors = std::min(TILE_VECTORS, (n - j + LANES - 1) / LANES);
            choose_tile<W>(rows, vectors, std::make_integer_sequence<int, TILE_ROWS * TILE_VECTORS>())(
                k, a + i * row, row, step, b + j * k, c + j, ld);
        }
        for (Index r = 0; r < rows; ++r) finish(i + r, c + r * ld);
    }
}

// x^T as the left factor of a product.
template <class T>
struct Left {
    const Word<T>* words;
    Index row, step;
};

// x has k rows and n columns, and lies in `buffer` afterwards in the order that suits the processor.
template <class T>
Left<T> transpose_left(const T* x, Index ld, Index k, Index n, Buffer& buffer) {
#ifdef TILES
    if constexpr (std::is_same_v<T, bfloat16>)
        if (n >= tiles::SIZE && words<T>(k) >= tiles::SIZE && tiles::granted()) {
            const Index row = round_up(words<T>(k), tiles::SIZE);
            Word<T>* out = buffer.of<Word<T>>(round_up(n, tiles::SIZE) * row);
            tiles::transpose_words(x, ld, k, n, out, row);
            return {out, row, 1};
        }
#endif
    Word<T>* out = buffer.of<Word<T>>(words<T>(k) * n);
    interleave(x, ld, k, n, out, n);
    return {out, 1, n};
}

template <class T, class Finish>
void product(Index m, Index n, Index k, Left<T> left, const Word<T>* b, Finish&& finish) {
    product(m, n, words<T>(k), left.words, left.row, left.step, b, finish);
}
