#include "engine/formats/outputs.h"

#include <algorithm>
#include <vector>

namespace locvol {
namespace {

constexpr std::uint64_t kBytesAtOnce = std::uint64_t{1} << 20;

}  // namespace

void AppendedFile::append_run(const Write& write, std::optional<std::uint64_t> num_bytes) {
  if (exchange_.num_ranks() == 1) return append_here(write);
  if (num_bytes) {
    const SumOfRanks place = sum(exchange_, *num_bytes);
    const std::uint64_t end = offset_ + place.all;
    offset_ += place.before;
    do_on_all(exchange_, [&] { append_here(write); });
    offset_ = end;
    return;
  }
  // Where it is to be, the first rank knows; others, when all lower ones have theirs.
  const std::uint64_t start = offset_;
  const bool is_first = exchange_.rank() == 0;
  std::optional<OpenFile> waiting;
  std::uint64_t bytes = 0;
  do_on_all(exchange_, [&] {
    if (is_first) {
      append_here(write);
      bytes = offset_ - start;
    } else {
      waiting.emplace(OpenFile::temporary(file_.name()));
      write(Append{[&](std::span<const std::byte> some) {
        waiting->write_at(bytes, some);
        bytes += some.size();
      }});
    }
  });
  const SumOfRanks place = sum(exchange_, bytes);
  do_on_all(exchange_, [&] {
    std::vector<std::byte> some;
    for (std::uint64_t done = 0; waiting && done < bytes; done += some.size()) {
      some.resize(std::min(bytes - done, kBytesAtOnce));
      waiting->read_at(done, some);
      file_.write_at(start + place.before + done, some);
    }
  });
  offset_ = start + place.all;
}

void AppendedFile::append_here(const Write& write) {
  write(Append{[&](std::span<const std::byte> bytes) {
    file_.write_at(offset_, bytes);
    offset_ += bytes.size();
  }});
}

}  // namespace locvol
