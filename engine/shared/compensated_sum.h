// A sum that keeps the rounding errors of its additions.
#pragma once

#include <cmath>
#include <tuple>

namespace locvol {

// Neumaier's: so good to about twice the digits of a double that its value does not depend on the
// order of its terms, but by a chance in billions.
class CompensatedSum {
 public:
  void add(double term) {
    const double sum = sum_ + term;
    lost_ += std::abs(sum_) >= std::abs(term) ? (sum_ - sum) + term : (term - sum) + sum_;
    sum_ = sum;
  }
  void add(const CompensatedSum& other) {
    add(other.sum_);
    lost_ += other.lost_;
  }
  void negate() {
    sum_ = -sum_;
    lost_ = -lost_;
  }
  double value() const { return sum_ + lost_; }
  // What makes it up, for those who send it. `sum`: a CompensatedSum or a const one
  template <class Self>
  static auto members(Self& sum) {
    return std::tie(sum.sum_, sum.lost_);
  }

 private:
  double sum_ = 0, lost_ = 0;
};

}  // namespace locvol
