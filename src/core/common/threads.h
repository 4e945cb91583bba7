// Independent work on the rows of a batch, on several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <vector>

#if !defined(__wasm__)  // without threads
#include <system_error>
#include <thread>
#endif

namespace pinproof {

// The rows that no thread has taken yet.
class Rows {
  public:
    explicit Rows(std::size_t count) : count_(count) {}

    // Take the next row; returns whether there is one.
    bool take(std::size_t& row) {
        row = next_.fetch_add(1, std::memory_order_relaxed);
        return row < count_;
    }

  private:
    std::atomic<std::size_t> next_{0};
    std::size_t count_;
};

// Calls `worker(rows)` on up to `threads` threads, each with its own worker from `make_worker()`, until all rows have
// been taken. The result of a row must not depend on the others. Workers must not throw.
template <class MakeWorker>
void share_rows(std::size_t count, std::size_t threads, MakeWorker make_worker) {
    constexpr std::size_t rows_per_thread = 32, most_threads = 1024;  // fewer rows are not worth a thread
    threads = std::clamp<std::size_t>(threads, 1, std::clamp<std::size_t>(count / rows_per_thread, 1, most_threads));
    std::vector<decltype(make_worker())> workers;
    workers.reserve(threads);
    for (std::size_t i = 0; i < threads; ++i) workers.push_back(make_worker());
    Rows rows(count);
#if !defined(__wasm__)
    std::vector<std::thread> others;
    others.reserve(threads - 1);
    try {
        for (std::size_t i = 1; i < threads; ++i) others.emplace_back([&rows, &worker = workers[i]] { worker(rows); });
    } catch (const std::system_error&) {
        // The system has no more threads; those that exist do the work.
    }
#endif
    workers[0](rows);
#if !defined(__wasm__)
    for (std::thread& other : others) other.join();
#endif
}

}  // namespace pinproof
