// IdlePool keeps what threads work with between their turns.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <type_traits>
#include <utility>
#include <vector>

namespace locvol {

// Holds as many as were ever in use at once. Safe from many threads.
template <class T>
class IdlePool {
 public:
  // Gives one that nobody uses, or *make() if there is none.
  template <class Make>
  std::unique_ptr<T> take(const Make& make) {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        std::unique_ptr<T> one = std::move(idle_.back());
        idle_.pop_back();
        return one;
      }
    }
    return make();
  }
  // What an error has left is better not used again.
  void put_back(std::unique_ptr<T> one) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(one));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<T>> idle_;
};

// Lends them out, and makes those that are missing. Safe from many threads.
template <class T>
class LendingPool {
 public:
  explicit LendingPool(std::function<std::unique_ptr<T>()> make) : make_(std::move(make)) {}
  // Returns use(one), of one that nobody uses meanwhile.
  template <class Use>
  auto with(const Use& use) {
    std::unique_ptr<T> one = idle_.take(make_);
    if constexpr (std::is_void_v<std::invoke_result_t<const Use&, T&>>) {
      use(*one);
      idle_.put_back(std::move(one));
    } else {
      auto result = use(*one);
      idle_.put_back(std::move(one));
      return result;
    }
  }

 private:
  std::function<std::unique_ptr<T>()> make_;
  IdlePool<T> idle_;
};

}  // namespace locvol
