// Layer norm of rows, forward and backward, with a scale and shift a member.

#include <omp.h>

#include "rows.h"

namespace {

struct Sizes {
    Index members, rows, width;
};

// Calls `work(row among all, member)` for all rows of one of the threads that run this.
template <class Work>
void for_own_rows(const Sizes& sizes, Work&& work) {
#pragma omp for schedule(static)
    for (Index row = 0; row < sizes.members * sizes.rows; ++row) work(row * sizes.width, row / sizes.rows * sizes.width);
}

template <class T>
void forward(const Sizes& sizes, int threads, const float* weight, const float* bias, const T* x, T* result) {
#pragma omp parallel num_threads(threads)
    for_own_rows(sizes, [&](Index row, Index member) {
        normalize(moments(x + row, sizes.width), x + row, sizes.width, weight + member, bias + member, result + row);
    });
}

template <class T>
void backward(const Sizes& sizes, int threads, const float* weight, const T* x, const T* gradient, T* x_gradient,
              float* const* gradients) {
#pragma omp parallel num_threads(threads)
    {
        thread_local Buffer buffer;
        float* wide = buffer.of<float>(sizes.width);
        float* const* mine = gradients ? gradients + omp_get_thread_num() * 2 : nullptr;
        for_own_rows(sizes, [&](Index row, Index member) {
            copy(gradient + row, sizes.width, wide);
            normalize_backward(moments(x + row, sizes.width), x + row, sizes.width, weight + member, wide,
                               mine ? mine[0] + member : nullptr, mine ? mine[1] + member : nullptr, x_gradient + row);
        });
    }
}

}  // namespace

extern "C" {

// s: members, rows of each, and their width, which is a multiple of 16.
#define DEFINE(NAME, T)                                                                                               \
    void norm_forward_##NAME(const std::int64_t* s, int threads, const float* weight, const float* bias, const T* x,  \
                             T* result) {                                                                             \
        forward<T>({s[0], s[1], s[2]}, threads, weight, bias, x, result);                                             \
    }                                                                                                                 \
    void norm_backward_##NAME(const std::int64_t* s, int threads, const float* weight, const T* x, const T* gradient, \
                              T* x_gradient, float* const* gradients) {                                               \
        backward<T>({s[0], s[1], s[2]}, threads, weight, x, gradient, x_gradient, gradients);                         \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
