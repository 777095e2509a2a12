// SPDX-License-Identifier: BSD-3-Clause
#include "report.hpp"

#include "assets.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::report {

bool available() { return assets().count("vega.js") > 0; }

void require_available() {
  if (!available())
    throw InputError(
        "--report: this build has no charting library, since npm was missing or could not install it; "
        "install npm, have the registry in reach and build again");
}

}  // namespace rangecal::report
