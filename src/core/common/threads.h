// Independent work on the rows of a batch, on several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <system_error>
#include <thread>
#include <vector>

namespace pinproof {

// Calls `worker(first, last)` for blocks of rows that cover [0, rows), on up to `threads` threads, each with its own
// worker from `make_worker()`. The result of a row must not depend on the others. Workers must not throw.
template <class MakeWorker>
void for_each_block(std::size_t rows, std::size_t threads, MakeWorker make_worker) {
    constexpr std::size_t block = 32, most_threads = 1024;
    threads = std::clamp<std::size_t>(threads, 1, std::clamp<std::size_t>(rows / block, 1, most_threads));
    std::vector<decltype(make_worker())> workers;
    workers.reserve(threads);
    for (std::size_t i = 0; i < threads; ++i) workers.push_back(make_worker());
    std::atomic<std::size_t> next{0};
    const auto run = [&](auto& worker) {
        for (;;) {
            const std::size_t first = next.fetch_add(block);
            if (first >= rows) return;
            worker(first, std::min(first + block, rows));
        }
    };
    std::vector<std::thread> others;
    others.reserve(threads - 1);
    try {
        for (std::size_t i = 1; i < threads; ++i) others.emplace_back([&run, &worker = workers[i]] { run(worker); });
    } catch (const std::system_error&) {
        // The system has no more threads; those that exist do the work.
    }
    run(workers[0]);
    for (std::thread& other : others) other.join();
}

}  // namespace pinproof
