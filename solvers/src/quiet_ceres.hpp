// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <glog/logging.h>

namespace rangecal {

/// Ceres warns through glog of every matrix that it cannot factor, whatever its own logging is set to, and
/// glog writes to stderr until its host says where to. A library does not print: unless the host has set glog
/// up, nothing is written.
inline void silence_ceres() {
  static const bool once = [] {
    if (!google::IsGoogleLoggingInitialized()) FLAGS_minloglevel = google::GLOG_FATAL;
    return true;
  }();
  static_cast<void>(once);
}

}  // namespace rangecal
