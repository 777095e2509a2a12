// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <glog/logging.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <string>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/version.hpp"

namespace rangecal::app {

/// That of the Logging which was started.
inline int verbose_level = 0;

/// What the solvers and Ceres say through glog: nothing, unless it is asked for.
struct Logging {
  std::string folder;  ///< of the log files; empty: none
  int level = 0;       ///< on stderr: 1 ends of solves and hypotheses of a search, 2 every iteration too

  void add_to(CLI::App& app) {
    const auto is_level = [](const std::string& given) {  // "true" where it stands alone
      const bool digits = given.find_first_not_of("0123456789") == std::string::npos && given.size() < 3;
      return given == "true" || digits ? std::string() : "'" + given + "' is not a level such as 2";
    };
    app.add_flag_function(
           "-v,--verbose",
           [this](std::int64_t given) { level = static_cast<int>(std::max<std::int64_t>(given, 0)); },
           "say on stderr how solves end and which causes a search weighs; -vv or --verbose=2: every iteration too")
        ->check(is_level, "LEVEL");
    app.add_option("--log-dir", folder, "folder for the solver's log files (default: no logs)");
  }

  /// To be called once, when the command line was read.
  void start(const char* program) const {
    FLAGS_v = 0;  // Ceres tells of its memory at 1, and at 2 has CHOLMOD print to stdout
    google::SetVLOGLevel("solver_log", level);
    verbose_level = level;
    FLAGS_logtostderr = false;
    FLAGS_alsologtostderr = false;
    FLAGS_stderrthreshold = level > 0 ? google::GLOG_INFO : google::GLOG_FATAL;
    FLAGS_minloglevel = level > 0 || !folder.empty() ? google::GLOG_INFO : google::GLOG_FATAL;
    if (folder.empty()) {
      FLAGS_logtostderr = level > 0;  // and no files
    } else {
      make_folder(folder);
      if (::access(folder.c_str(), W_OK) != 0) throw InputError(folder + ": --log-dir cannot be written to");
      FLAGS_log_dir = folder;
    }
    google::InitGoogleLogging(program);
    LOG(INFO) << "rangecal " << version();
  }
};

}  // namespace rangecal::app
