// How factors of matrix products lie in memory.
//
// They are read in words: a float, or two bfloat16 that are neighbors along the inner axis, which the processor multiplies
// and adds in one step. The right one is packed in panels of PANEL columns, so that a step of the inner loop reads one
// stretch of it.

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <utility>

#ifdef __AVX512F__
#include <immintrin.h>
#endif

using Index = std::ptrdiff_t;

#ifdef __AVX512F__
constexpr Index LANES = 16, TILE_ROWS = 6, TILE_VECTORS = 4;  // 24 of the 32 registers hold sums.
#else
constexpr Index LANES = 8, TILE_ROWS = 6, TILE_VECTORS = 2;  // 12 of the 16 registers hold sums.
#endif
constexpr Index PANEL = LANES * TILE_VECTORS;
typedef float Floats __attribute__((vector_size(4 * LANES), may_alias));
typedef std::int32_t Integers __attribute__((vector_size(4 * LANES), may_alias));

// Numbers of four bytes; lanes from `count` on are zeros.
template <class Vector>
Vector load_part(const void* x, Index count) {
#ifdef __AVX512F__
    return (Vector)_mm512_maskz_loadu_epi32(__mmask16((1u << count) - 1), x);
#else
    Vector found = {};
    std::memcpy(&found, x, count * 4);
    return found;
#endif
}
inline Floats load(const float* x) {
    Floats found;
    std::memcpy(&found, x, sizeof(found));
    return found;
}
inline void store(float* out, Floats x) { std::memcpy(out, &x, sizeof(x)); }

struct bfloat16 {
    std::uint16_t bits;
};

#ifdef __AVX512BF16__
inline Floats load(const bfloat16* x) {
    return (Floats)_mm512_slli_epi32(_mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i*)x)), 16);
}
inline void store(bfloat16* out, Floats x) { _mm256_storeu_si256((__m256i*)out, (__m256i)_mm512_cvtneps_pbh((__m512)x)); }
#endif

inline Floats all(float x) { return x - Floats{}; }
inline Integers lanes() {
    Integers found;
    for (int i = 0; i < LANES; ++i) found[i] = i;
    return found;
}
inline float total(Floats x) {
#pragma GCC unroll 4
    for (int size = LANES / 2; size; size /= 2) x += __builtin_shuffle(x, lanes() ^ size);
    return x[0];
}
inline float greatest(Floats x) {
#pragma GCC unroll 4
    for (int size = LANES / 2; size; size /= 2) {
        const Floats other = __builtin_shuffle(x, lanes() ^ size);
        x = other > x ? other : x;
    }
    return x[0];
}

template <class T>
struct Words;
template <>
struct Words<float> {
    using type = float;
    static constexpr Index size = 1;  // Numbers in a word.
};
template <>
struct Words<bfloat16> {
    using type = std::uint32_t;
    static constexpr Index size = 2;
};
template <class T>
using Word = typename Words<T>::type;

inline Index round_up(Index n, Index step) { return (n + step - 1) / step * step; }
template <class T>
inline Index words(Index n) { return (n + Words<T>::size - 1) / Words<T>::size; }
template <class T>
inline Index packed_size(Index k, Index n) { return words<T>(k) * round_up(n, PANEL); }
template <class T>
inline const Word<T>* as_words(const T* x) { return reinterpret_cast<const Word<T>*>(x); }

// Memory of a thread, aligned for vectors, that only grows.
class Buffer {
  public:
    template <class T>
    T* of(Index count) {
        const Index bytes = round_up(count * Index(sizeof(T)) + 64, 64);
        if (bytes > bytes_) {
            memory_.reset(std::aligned_alloc(64, bytes));
            if (!memory_) throw std::bad_alloc();
            bytes_ = bytes;
        }
        return static_cast<T*>(memory_.get());
    }

  private:
    struct Free {
        void operator()(void* memory) const { std::free(memory); }
    };
    std::unique_ptr<void, Free> memory_;
    Index bytes_ = 0;
};

inline float word(const float* x, const float* = nullptr) { return *x; }
inline std::uint32_t word(const bfloat16* x, const bfloat16* next) { return x->bits | std::uint32_t(next->bits) << 16; }
inline std::uint32_t word(const bfloat16* x) { return x->bits; }

// out[i * step + j]: word i of column j of x (k rows, n columns).
template <class T>
void interleave(const T* __restrict x, Index ld, Index k, Index n, Word<T>* __restrict out, Index step) {
    Index i = 0;
    for (; i < k / Words<T>::size; ++i, x += Words<T>::size * ld)
#pragma omp simd
        for (Index j = 0; j < n; ++j) out[i * step + j] = word(x + j, x + ld + j);
    if (i < words<T>(k))
        for (Index j = 0; j < n; ++j) out[i * step + j] = word(x + j);
}

// Panels of b = x (k rows, n columns); columns up to the next multiple of LANES are zeros.
template <class T>
void pack(const T* x, Index ld, Index k, Index n, Word<T>* out) {
    for (Index j = 0; j < n; j += PANEL, out += words<T>(k) * PANEL) {
        const Index width = std::min(PANEL, n - j);
        interleave(x + j, ld, k, width, out, PANEL);
        for (Index i = 0; width % LANES && i < words<T>(k); ++i)
            std::fill(out + i * PANEL + width, out + i * PANEL + round_up(width, LANES), Word<T>());
    }
}

// Swaps rows and columns of LANES x LANES words: in each step, of the blocks of half the size.
inline void transpose(Integers rows[LANES]) {
#pragma GCC unroll 4
    for (int size = LANES / 2; size; size /= 2) {
        const Integers kept = lanes() & ~size, upper = (lanes() & size) != 0;  // Lanes from LANES on: the second operand.
        const Integers first = kept + (upper & LANES), second = first + size;
#pragma GCC unroll 16
        for (int i = 0; i < LANES; ++i)
            if (!(i & size)) {
                const Integers a = rows[i], b = rows[i + size];
                rows[i] = __builtin_shuffle(a, b, first);
                rows[i + size] = __builtin_shuffle(a, b, second);
            }
    }
}

// Panels of b = x^T (x has n rows and k columns, a whole number of words).
template <class T>
void pack_transposed(const T* x, Index ld, Index k, Index n, Word<T>* out) {
    for (Index j = 0; j < n; j += LANES) {
        Word<T>* panel = out + j / PANEL * words<T>(k) * PANEL + j % PANEL;
        for (Index i = 0; i < words<T>(k); i += LANES) {
            const Index width = std::min(LANES, words<T>(k) - i);
            Integers rows[LANES];
#pragma GCC unroll 16
            for (int c = 0; c < LANES; ++c)
                rows[c] = j + c < n ? load_part<Integers>(as_words(x + (j + c) * ld) + i, width) : Integers{};
            transpose(rows);
            for (int c = 0; c < width; ++c) std::memcpy(panel + (i + c) * PANEL, &rows[c], sizeof(Integers));
        }
    }
}
