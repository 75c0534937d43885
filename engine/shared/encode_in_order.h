// Encodes on all threads what must be read, and written, in order.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#include "engine/shared/workers.h"

namespace locvol {

// Calls take(encode(item)) for each item that `next` gives, until it gives none (an empty
// optional). `next` and `take` are called by one thread at a time, and in order; `encode` beside
// them, by any thread. Errors as Workers::run_in_order().
template <class Next, class Encode, class Take>
void encode_in_order(Workers& workers, Next next, const Encode& encode, Take take) {
  using Item = typename std::invoke_result_t<Next&>::value_type;
  using Result = std::invoke_result_t<const Encode&, const Item&>;
  struct ItemTask : Task {
    ItemTask(Item the_item, const Encode& encode, Take& take)
        : encode_(encode), take_(take), item_(std::move(the_item)) {}
    void compute() override {
      result_.emplace(encode_(*item_));
      item_.reset();
    }
    void apply() override { take_(*std::exchange(result_, std::nullopt)); }

    const Encode& encode_;
    Take& take_;
    std::optional<Item> item_;
    std::optional<Result> result_;
  };
  workers.run_in_order([&]() -> std::unique_ptr<Task> {
    auto item = next();
    return item ? std::make_unique<ItemTask>(*std::move(item), encode, take) : nullptr;
  });
}

}  // namespace locvol
