// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "rangecal/solvers/extract/scan_source.hpp"

namespace rangecal::extract {

/// The scans of several sources, end to end.
class AllScans {
 public:
  /// `clockwise`: the bearings of the files run clockwise; they are turned round.
  AllScans(std::span<ScanSource* const> sources, bool clockwise) : sources_(sources), clockwise_(clockwise) {}

  /// The first reading of all sources; see there.
  void survey(const ScanSource::Look& look);
  /// After it: the logs, the scans without their beams, and reading them again by their place among all.
  const std::vector<const ScanLog*>& logs() const { return logs_; }
  std::size_t size() const { return heads_.size(); }
  const Scan& head(std::size_t scan) const { return *heads_[scan]; }
  void read(const ScanSource::Take& take) const;

 private:
  std::span<ScanSource* const> sources_;
  bool clockwise_;
  std::vector<const ScanLog*> logs_;
  std::vector<const Scan*> heads_;
};

}  // namespace rangecal::extract
