// Products of bfloat16 matrices by tiles of 16 rows of 16 words, on processors that have them (AMX).
//
// Two by two tiles of sums are held at a time: each tile that is loaded serves two multiplications.

#pragma once

#include "packing.h"

#if defined(__AMX_BF16__) && defined(__AVX512BF16__)
#define TILES
#include <sys/syscall.h>
#include <unistd.h>

namespace tiles {

constexpr Index SIZE = 16;  // Rows of a tile, and words (or sums) in a row of it.
enum { UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT, UPPER, LOWER, LEFT, RIGHT };

// Linux grants a process the registers on request; other threads of it may use them then.
inline bool granted() {
    constexpr int REQUEST = 0x1023, TILE_DATA = 18;
    static const bool answer = syscall(SYS_arch_prctl, REQUEST, TILE_DATA) == 0;
    return answer;
}

// The compiler's own intrinsics do not say which memory they read.
template <int tile>
inline void clear() { asm volatile("tilezero %%tmm%c0" : : "i"(tile)); }
template <int tile>
inline void load(const std::uint32_t* x, Index row) {
    asm volatile("tileloadd (%0,%1,1), %%tmm%c2" : : "r"(x), "r"(4 * row), "i"(tile) : "memory");
}
template <int tile>
inline void store(float* out, Index row) {
    asm volatile("tilestored %%tmm%c2, (%0,%1,1)" : : "r"(out), "r"(4 * row), "i"(tile) : "memory");
}
template <int sum, int a, int b>
inline void multiply_add() { asm volatile("tdpbf16ps %%tmm%c2, %%tmm%c1, %%tmm%c0" : : "i"(sum), "i"(a), "i"(b)); }

struct alignas(64) Shapes {
    std::uint8_t palette = 1, first_row = 0, unused[14] = {};
    std::uint16_t row_bytes[16] = {};
    std::uint8_t rows[16] = {};

    void set(int tile, Index count) {
        row_bytes[tile] = 4 * SIZE;
        rows[tile] = std::uint8_t(count);
    }
};

// Gives the upper and the lower tiles so many rows.
inline void shape(Index upper, Index lower) {
    Shapes shapes;
    for (int tile : {UPPER_LEFT, UPPER_RIGHT, UPPER}) shapes.set(tile, upper);
    for (int tile : {LOWER_LEFT, LOWER_RIGHT, LOWER})
        if (lower) shapes.set(tile, lower);
    for (int tile : {LEFT, RIGHT}) shapes.set(tile, SIZE);
    asm volatile("ldtilecfg %0" : : "m"(shapes));
}

template <bool lower, bool right>
inline void step(const std::uint32_t* a, Index row, const std::uint32_t* b, Index panel) {
    load<UPPER>(a, row);
    load<LEFT>(b, panel);
    multiply_add<UPPER_LEFT, UPPER, LEFT>();
    if constexpr (right) {
        load<RIGHT>(b + SIZE, panel);
        multiply_add<UPPER_RIGHT, UPPER, RIGHT>();
    }
    if constexpr (lower) {
        load<LOWER>(a + SIZE * row, row);
        multiply_add<LOWER_LEFT, LOWER, LEFT>();
        if constexpr (right) multiply_add<LOWER_RIGHT, LOWER, RIGHT>();
    }
}

// c = a b over k words, of which the last k % SIZE are read from `rest`: SIZE words a row, zeros behind the last.
template <bool lower, bool right>
void sum(Index k, const std::uint32_t* a, Index row, const std::uint32_t* rest, const std::uint32_t* b, float* c, Index ld) {
    clear<UPPER_LEFT>();
    if constexpr (right) clear<UPPER_RIGHT>();
    if constexpr (lower) clear<LOWER_LEFT>();
    if constexpr (lower && right) clear<LOWER_RIGHT>();
    const Index whole = k / SIZE * SIZE;
    for (Index i = 0; i < whole; i += SIZE) step<lower, right>(a + i, row, b + i * PANEL, PANEL);
    if (whole < k) {
        alignas(64) std::uint32_t last[SIZE][2 * SIZE] = {};
        for (Index i = whole; i < k; ++i) std::memcpy(last[i - whole], b + i * PANEL, (right ? 8 : 4) * SIZE);
        step<lower, right>(rest, SIZE, last[0], 2 * SIZE);
    }
    store<UPPER_LEFT>(c, ld);
    if constexpr (right) store<UPPER_RIGHT>(c + SIZE, ld);
    if constexpr (lower) store<LOWER_LEFT>(c + SIZE * ld, ld);
    if constexpr (lower && right) store<LOWER_RIGHT>(c + SIZE * ld + SIZE, ld);
}

// Words of x's columns (k rows, n columns) in rows of `row` words; zeros behind the last.
inline void transpose_words(const bfloat16* x, Index ld, Index k, Index n, std::uint32_t* out, Index row) {
    const auto half = [&](Index i, Index j) {
        __m256i found = {};
        if (i < k) std::memcpy(&found, x + i * ld + j, 2 * std::min(SIZE, n - j));
        return _mm512_cvtepu16_epi32(found);
    };
    for (Index j = 0; j < n; j += SIZE)
        for (Index i = 0; i < row; i += SIZE) {
            Integers block[LANES];
#pragma GCC unroll 16
            for (Index r = 0; r < SIZE; ++r)
                block[r] = (Integers)_mm512_or_si512(half(2 * (i + r), j), _mm512_slli_epi32(half(2 * (i + r) + 1, j), 16));
            transpose(block);
            for (Index r = 0; r < SIZE; ++r) std::memcpy(out + (j + r) * row + i, &block[r], sizeof(Integers));
        }
}

// As `product`, with rows of a whose words are neighbors.
template <class Finish>
void product(Index m, Index n, Index k, const std::uint32_t* a, Index row, const std::uint32_t* b, Finish&& finish) {
    thread_local Buffer sums;
    const Index ld = round_up(n, LANES), whole = k / SIZE * SIZE;
    float* c = sums.of<float>(2 * SIZE * ld);
    std::uint32_t rest[2 * SIZE][SIZE] = {};
    for (Index i = 0; i < m; i += 2 * SIZE, a += 2 * SIZE * row) {
        const Index upper = std::min(SIZE, m - i), lower = std::min(SIZE, m - i - upper);
        for (Index r = 0; whole < k && r < upper + lower; ++r) std::memcpy(rest[r], a + r * row + whole, 4 * (k - whole));
        shape(upper, lower);
        for (Index j = 0; j < n; j += 2 * SIZE) {
            const bool right = n - j > SIZE;
            const auto own = lower ? (right ? sum<true, true> : sum<true, false>)
                                   : (right ? sum<false, true> : sum<false, false>);
            own(k, a, row, rest[0], b + j / PANEL * PANEL * k + j % PANEL, c + j, ld);
        }
        for (Index r = 0; r < upper + lower; ++r) finish(i + r, c + r * ld);
    }
    asm volatile("tilerelease");
}

}  // namespace tiles
#endif
