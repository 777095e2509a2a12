// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "rangecal/core/scan.hpp"

namespace rangecal {

/// The scans of one file, read as often as they are needed, so that a long bag is never in memory as a whole.
class ScanSource {
 public:
  using Look = std::function<void(const Scan& scan)>;
  using Take = std::function<void(std::size_t index, const Scan& scan)>;

  virtual ~ScanSource() = default;
  /// The first reading. Gives each scan to `look`, without its odometry where that stands in the file after it; those that turn out
  /// to have none, where they should, are among them. Called once, before all else.
  virtual void survey(const Look& look) = 0;
  /// What the survey found, the scans without their beams.
  virtual const ScanLog& log() const = 0;
  /// Gives the scans of log() again, with their beams and in this order. Throws InputError where the file has changed.
  virtual void read(const Take& take) = 0;
};

/// A log in memory.
class ScansInMemory final : public ScanSource {
 public:
  explicit ScansInMemory(ScanLog log);
  void survey(const Look& look) override;
  const ScanLog& log() const override { return heads_; }
  void read(const Take& take) override;

 private:
  std::vector<Scan> scans_;
  ScanLog heads_;
};

/// The scan without its beams.
Scan head_of(const Scan& scan);

}  // namespace rangecal
