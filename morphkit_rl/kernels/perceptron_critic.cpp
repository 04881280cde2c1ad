// Perceptron critics of many robots, forward and backward. For row b of robot r, whose scalars have the learned vectors
// t_1, t_2, ...:
//
//     y_0 = sum_i v_i t_i + r        h_k = relu(norm_k(y_k))        y_k = h_(k-1) W_k + b_k        result = h_last W + b
//
// Rows of a robot follow each other. Robots with many texts in common form a group, in whose rows scalars are
// laid out by text, zero where a robot has none, so that one product serves all of them. Each thread carries blocks of rows through all layers, so that what lies between
// two products never leaves its cache. Only the y_k are kept for the way back. Sums are float32. Members are independent
// networks with the same scalars.

#include <omp.h>
#include <vector>

#include "rows.h"

namespace {

constexpr Index BLOCK_ROWS = 192;  // At most so many rows a block.

// Parameters: token vectors, robot vectors, head and its bias, first norm's scale and shift, then four a hidden layer.
enum { TOKEN, ROBOT, HEAD, HEAD_BIAS, NORM, NORM_BIAS, HIDDEN };
constexpr int WEIGHT = 0, BIAS = 1, SCALE = 2, SHIFT = 3, A_LAYER = 4;

// What a robot reads of an observation row and an action row.
struct Reading {
    std::int64_t obs, obs_count, action, action_count, vector, first, group;  // `first`: its place in the list of places.
};

// Robots that are read together.
struct Group {
    std::int64_t first, texts;  // Place in the groups' list of texts, and how many are its own.
};

struct Problem {
    Index members, batch, robots, width, layers, outputs, obs_width, action_width, texts, robot_vectors;
    const Reading* readings;
    const std::int64_t* place;  // Of every scalar among its group's texts, robot by robot.
    const Group* groups;
    const std::int64_t* text;  // Row of the vector of every text, group by group.
    Index group_count;
    const float *obs, *action;

    Index rows() const { return batch * robots; }
    Index padded_outputs() const { return round_up(outputs, LANES); }
    Index parameters() const { return HIDDEN + A_LAYER * layers; }
    int hidden(Index layer, int part) const { return HIDDEN + A_LAYER * int(layer - 1) + part; }
    int scale(Index layer) const { return layer ? hidden(layer, SCALE) : NORM; }
    int shift(Index layer) const { return layer ? hidden(layer, SHIFT) : NORM_BIAS; }
    // Numbers of a member.
    Index size(int parameter) const {
        switch (parameter) {
            case TOKEN: return texts * width;
            case ROBOT: return robot_vectors * width;
            case HEAD: return width * outputs;
            case HEAD_BIAS: return outputs;
            case NORM: case NORM_BIAS: return width;
            default: return (parameter - HIDDEN) % A_LAYER == WEIGHT ? width * width : width;
        }
    }
};

// Matrices of all members in panels, for h W or for g W^T: hidden layers from 1 on, the head, then each group's vectors.
template <class T>
class Packed {
  public:
    // To be called by all threads of a parallel region. `first_layer`: whether the groups' vectors are wanted.
    void fill(const Problem& p, const float* const* parameters, bool transposed, bool first_layer) {
        const Index matrices = p.layers + 1 + (first_layer ? p.group_count : 0);
#pragma omp single
        {
            starts_.assign(p.members * matrices + 1, 0);
            matrices_ = matrices;
            for (Index part = 0; part < p.members * matrices; ++part) {
                const auto [k, n] = shape(p, part % matrices);
                starts_[part + 1] = starts_[part] + round_up(transposed ? packed_size<T>(n, k) : packed_size<T>(k, n), 16);
            }
            memory_.template of<Word<T>>(starts_.back());
        }
#pragma omp for schedule(dynamic)
        for (Index part = 0; part < p.members * matrices; ++part) {
            const Index matrix = part % matrices, member = part / matrices;
            const auto [k, n] = shape(p, matrix);
            thread_local Buffer buffer;
            T* narrowed = buffer.of<T>(k * n);
            if (matrix < p.layers)
                copy(parameters[p.hidden(matrix + 1, WEIGHT)] + member * k * n, k * n, narrowed);
            else if (matrix == p.layers)
                for (Index i = 0; i < k; ++i)
                    copy_part(parameters[HEAD] + (member * k + i) * p.outputs, p.outputs, narrowed + i * n);
            else {
                const std::int64_t* text = p.text + p.groups[matrix - p.layers - 1].first;
                for (Index i = 0; i < k; ++i)
                    copy(parameters[TOKEN] + (member * p.texts + text[i]) * n, n, narrowed + i * n);
            }
            Word<T>* out = memory_.template of<Word<T>>(0) + starts_[part];
            transposed ? pack_transposed(narrowed, n, n, k, out) : pack(narrowed, n, k, n, out);
        }
    }
    const Word<T>* hidden(Index member, Index layer) { return get(member, layer - 1); }
    const Word<T>* head(const Problem& p, Index member) { return get(member, p.layers); }
    const Word<T>* vectors(const Problem& p, Index member, Index group) { return get(member, p.layers + 1 + group); }

  private:
    Buffer memory_;
    std::vector<Index> starts_;
    Index matrices_;

    static std::pair<Index, Index> shape(const Problem& p, Index matrix) {
        if (matrix < p.layers) return {p.width, p.width};
        if (matrix == p.layers) return {p.width, p.padded_outputs()};
        return {p.groups[matrix - p.layers - 1].texts, p.width};
    }
    const Word<T>* get(Index member, Index matrix) {
        return memory_.template of<Word<T>>(0) + starts_[member * matrices_ + matrix];
    }
};

// Rows of a member, and the part of a block that belongs to one group.
struct Block {
    Index member, row, rows;
};
struct Segment {
    Index group, rows, row;  // `row`: within the block.
};

struct Scratch {
    Buffer scalars, row, hidden, gradient[2], left, right, wide;
};

template <class T>
class Network {
  public:
    Network(const Problem& p, const float* const* parameters, T* const* saved, Packed<T>& packed)
        : p(p), parameters(parameters), saved(saved), packed(packed) {}

    void forward(const Block& block, float* result) {
        const Index width = p.width, outputs = p.outputs;
        T* h = scratch.hidden.of<T>(block.rows * width);
        each_segment(block, [&](const Segment& s) {
            apply(read(block, s), s.rows, p.groups[s.group].texts, width, packed.vectors(p, block.member, s.group),
                  [&](Index r, const float* values) {
                keep(block, 0, s.row + r, values, get(ROBOT, block) + reading(block, s.row + r).vector * width, h);
            });
        });
        for (Index layer = 1; layer <= p.layers; ++layer) {
            const float* bias = get(p.hidden(layer, BIAS), block);
            T* next = scratch.gradient[layer % 2].of<T>(block.rows * width);
            apply(h, block.rows, width, width, packed.hidden(block.member, layer),
                  [&](Index r, const float* values) { keep(block, layer, r, values, bias, next); });
            h = next;
        }
        const float* bias = get(HEAD_BIAS, block);
        apply(h, block.rows, width, p.padded_outputs(), packed.head(p, block.member), [&](Index r, const float* values) {
            float* out = result + place(block, r) * outputs;
#pragma omp simd
            for (Index i = 0; i < outputs; ++i) out[i] = values[i] + bias[i];
        });
    }

    // `packed` holds the transposed matrices here. Gradients of parameters are added, unless their pointers are null.
    void backward(const Block& block, const float* result_gradient, float* obs_gradient, float* action_gradient,
                  float* const* gradients) {
        const Index width = p.width, padded = p.padded_outputs();
        T* g = scratch.wide.of<T>(block.rows * padded);
        for (Index r = 0; r < block.rows; ++r)
            copy_part(result_gradient + place(block, r) * p.outputs, p.outputs, g + r * padded);
        const auto gradient = [&](int parameter) {
            return gradients ? gradients[parameter] + block.member * p.size(parameter) : nullptr;
        };
        T* h = scratch.hidden.of<T>(block.rows * width);
        for (Index layer = p.layers + 1; layer-- > 0;) {
            const bool head = layer == p.layers;
            const Index n = head ? padded : width;
            T* out = scratch.gradient[layer % 2].of<T>(block.rows * width);
            apply(g, block.rows, n, width, head ? packed.head(p, block.member) : packed.hidden(block.member, layer + 1),
                  [&](Index r, float* values) { pass(block, layer, r, values, gradient, h, out); });
            if (gradients) {
                const int weight = head ? HEAD : p.hidden(layer + 1, WEIGHT), bias = head ? HEAD_BIAS : weight + BIAS;
                const Index used = head ? p.outputs : width;
                float *sums = gradient(weight), *bias_sums = gradient(bias);
                weigh(h, width, width, g, n, block.rows, [&](Index r) { return sums + r * used; }, used);
                for (Index r = 0; r < block.rows; ++r)
                    for (Index i = 0; i < used; i += LANES)
                        add_part(g + r * n + i, std::min(LANES, used - i), bias_sums + i);
            }
            g = out;
        }
        each_segment(block, [&](const Segment& s) { leave(block, s, g + s.row * width, obs_gradient, action_gradient, gradient); });
    }

  private:
    const Problem& p;
    const float* const* parameters;
    T* const* saved;
    Packed<T>& packed;
    inline static thread_local Scratch scratch;

    const float* get(int parameter, const Block& block) const {
        return parameters[parameter] + block.member * p.size(parameter);
    }
    // Row of the result of a block's row: samples in order, and in them robots.
    Index place(const Block& block, Index r) const {
        const Index row = block.row + r;
        return (block.member * p.batch + row % p.batch) * p.robots + row / p.batch;
    }
    T* kept(const Block& block, Index layer, Index r) const {
        return saved[layer] + (block.member * p.rows() + block.row + r) * p.width;
    }

    const Reading& reading(const Block& block, Index r) const { return p.readings[(block.row + r) / p.batch]; }

    template <class Work>
    void each_segment(const Block& block, Work&& work) {
        for (Index row = 0; row < block.rows;) {
            const Index group = reading(block, row).group;
            Index last = row;
            while (last < block.rows && reading(block, last).group == group) last += p.batch - (block.row + last) % p.batch;
            last = std::min(last, block.rows);
            work(Segment{group, last - row, row});
            row = last;
        }
    }

    template <class Finish>
    void apply(const T* in, Index rows, Index k, Index n, const Word<T>* matrix, Finish&& finish) {
        product(rows, n, words<T>(k), as_words(in), words<T>(k), 1, matrix, finish);
    }

    // The scalars of a segment by text, each row a whole number of words.
    T* read(const Block& block, const Segment& s) {
        const Index size = row_size(s);
        T* out = scratch.scalars.of<T>(s.rows * size + LANES);
        float* row = scratch.row.of<float>(size + LANES);
        for (Index r = 0; r < s.rows; ++r) {
            const Reading& own = reading(block, s.row + r);
            const std::int64_t* place = p.place + own.first;
            const Index sample = (block.row + s.row + r) % p.batch;
            const float* obs = p.obs + sample * p.obs_width + own.obs;
            const float* action = p.action + sample * p.action_width + own.action;
            std::fill(row, row + round_up(size, LANES), 0.0f);
            for (Index i = 0; i < own.obs_count; ++i) row[place[i]] += obs[i];
            for (Index i = 0; i < own.action_count; ++i) row[place[own.obs_count + i]] += action[i];
            copy_exactly(row, size, out + r * size);
        }
        return out;
    }
    Index row_size(const Segment& s) const { return words<T>(p.groups[s.group].texts) * Words<T>::size; }
    static void copy_exactly(const float* x, Index n, T* out) {
        Index i = 0;
        for (; i + LANES <= n; i += LANES) store(out + i, load(x + i));
        T part[LANES];
        copy_part(x + i, n - i, part);
        std::copy_n(part, n - i, out + i);
    }
    static void add_part(const T* x, Index count, float* sum) {
        if (count == LANES) return add(x, LANES, sum);
        float wide[LANES];
        copy(x, LANES, wide);
        for (Index i = 0; i < count; ++i) sum[i] += wide[i];
    }

    // y = values + bias, kept, and h = relu(norm(y)).
    void keep(const Block& block, Index layer, Index r, const float* values, const float* bias, T* h) {
        const Index width = p.width;
        T* y = saved[0] ? kept(block, layer, r) : scratch.wide.of<T>(width);
        for (Index i = 0; i < width; i += LANES) store(y + i, load(values + i) + load(bias + i));
        rectify(block, layer, y, h + r * width);
    }
    Moments rectify(const Block& block, Index layer, const T* y, T* h) {
        const float *scale = get(p.scale(layer), block), *shift = get(p.shift(layer), block);
        const Moments own = moments(y, p.width);
        for (Index i = 0; i < p.width; i += LANES) {
            const Floats x = (load(y + i) - own.mean) * own.scale * load(scale + i) + load(shift + i);
            store(h + i, x > 0 ? x : all(0));
        }
        return own;
    }
    // From the gradient `values` of a row of h to that of y; computes h again.
    template <class Gradient>
    void pass(const Block& block, Index layer, Index r, float* values, const Gradient& gradient, T* h, T* out) {
        const Index width = p.width;
        const T* y = kept(block, layer, r);
        T* own_h = h + r * width;
        const Moments own = rectify(block, layer, y, own_h);
        for (Index i = 0; i < width; i += LANES) store(values + i, load(own_h + i) > 0 ? load(values + i) : all(0));
        normalize_backward(own, y, width, get(p.scale(layer), block), values, gradient(p.scale(layer)),
                           gradient(p.shift(layer)), out + r * width);
    }
    // From the gradient g of the first layer's y to those of vectors, observations and actions.
    template <class Gradient>
    void leave(const Block& block, const Segment& s, const T* g, float* obs_gradient, float* action_gradient,
               const Gradient& gradient) {
        const Group& group = p.groups[s.group];
        const Index width = p.width;
        if (float* sums = gradient(TOKEN)) {
            weigh(read(block, s), row_size(s), group.texts, g, width, s.rows,
                  [&](Index r) { return sums + p.text[group.first + r] * width; }, width);
            for (Index r = 0; r < s.rows; ++r)
                add(g + r * width, width, gradient(ROBOT) + reading(block, s.row + r).vector * width);
        }
        if (!obs_gradient && !action_gradient) return;
        apply(g, s.rows, width, group.texts, packed.vectors(p, block.member, s.group), [&](Index r, const float* values) {
            const Reading& own = reading(block, s.row + r);
            const Index sample = block.member * p.batch + (block.row + s.row + r) % p.batch;
            const auto pick = [&](float* out, Index count, const std::int64_t* place) {
                for (Index i = 0; out && i < count; ++i) out[i] = values[place[i]];
            };
            const std::int64_t* place = p.place + own.first;
            pick(obs_gradient ? obs_gradient + sample * p.obs_width + own.obs : nullptr, own.obs_count, place);
            pick(action_gradient ? action_gradient + sample * p.action_width + own.action : nullptr, own.action_count,
                 place + own.obs_count);
        });
    }

    // Adds in^T g (m x used numbers) to the rows that `sums` gives.
    template <class Sums>
    void weigh(const T* in, Index in_step, Index m, const T* g, Index n, Index rows, Sums&& sums, Index used) {
        Word<T>* right = scratch.right.of<Word<T>>(packed_size<T>(rows, n));
        const Left<T> left = transpose_left(in, in_step, rows, m, scratch.left);
        pack(g, n, rows, n, right);
        product(m, n, rows, left, right, [&](Index r, const float* values) {
            float* sum = sums(r);
#pragma omp simd
            for (Index i = 0; i < used; ++i) sum[i] += values[i];
        });
    }
};

// Calls `work` with the blocks of one of the threads that run this: always the same ones, so that sums are, too.
template <class Work>
void for_own_blocks(const Problem& p, Work&& work) {
    const Index rows = p.rows(), blocks = round_up((rows + BLOCK_ROWS - 1) / BLOCK_ROWS, omp_get_num_threads()),
                size = (rows + blocks - 1) / blocks;
#pragma omp for schedule(static)
    for (Index part = 0; part < p.members * blocks; ++part) {
        const Index row = part % blocks * size, count = std::min(size, rows - row);
        if (count > 0) work(Block{part / blocks, row, count});
    }
}

template <class T>
void forward(const Problem& p, int threads, const float* const* parameters, T* const* saved, float* result) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;  // The threads use the caller's.
#pragma omp parallel num_threads(threads)
    {
        packed.fill(p, parameters, false, true);
        Network<T> network(p, parameters, saved, packed);
        for_own_blocks(p, [&](const Block& block) { network.forward(block, result); });
    }
}

template <class T>
void backward(const Problem& p, int threads, const float* const* parameters, T* const* saved,
              const float* result_gradient, float* obs_gradient, float* action_gradient, float* const* gradients) {
    thread_local Packed<T> own;
    Packed<T>& packed = own;
#pragma omp parallel num_threads(threads)
    {
        packed.fill(p, parameters, true, obs_gradient || action_gradient);
        Network<T> network(p, parameters, saved, packed);
        float* const* mine = gradients ? gradients + omp_get_thread_num() * p.parameters() : nullptr;
        for_own_blocks(p, [&](const Block& block) {
            network.backward(block, result_gradient, obs_gradient, action_gradient, mine);
        });
    }
}

Problem problem(const std::int64_t* s, const std::int64_t* const* tables, const float* obs, const float* action) {
    return {s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8], s[9], reinterpret_cast<const Reading*>(tables[0]),
            tables[1], reinterpret_cast<const Group*>(tables[2]), tables[3], s[10], obs, action};
}

}  // namespace

extern "C" {

// s: members, batch, robots, width, layers, outputs, widths of an observation row and of an action row, numbers of token
// vectors, of robot vectors and of groups. tables: readings, places, groups and texts, as in `Problem`. Gradients of
// observations and actions have a leading axis of members.
#define DEFINE(NAME, T)                                                                                                \
    void critic_forward_##NAME(const std::int64_t* s, int threads, const std::int64_t* const* tables,                  \
                               const float* const* parameters, const float* obs, const float* action,                 \
                               T* const* saved, float* result) {                                                       \
        forward<T>(problem(s, tables, obs, action), threads, parameters, saved, result);                               \
    }                                                                                                                  \
    void critic_backward_##NAME(const std::int64_t* s, int threads, const std::int64_t* const* tables,                 \
                                const float* const* parameters, const float* obs, const float* action,                \
                                T* const* saved, const float* gradient, float* obs_gradient, float* action_gradient,   \
                                float* const* gradients) {                                                             \
        backward<T>(problem(s, tables, obs, action), threads, parameters, saved, gradient, obs_gradient,               \
                    action_gradient, gradients);                                                                       \
    }

DEFINE(float32, float)
#ifdef __AVX512BF16__
DEFINE(bfloat16, bfloat16)
#endif
}
