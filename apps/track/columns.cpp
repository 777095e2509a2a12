// SPDX-License-Identifier: BSD-3-Clause
#include "track/columns.hpp"

#include "rangecal/core/errors.hpp"
#include "rangecal/core/utf8.hpp"
#include "track/line_source.hpp"

namespace rangecal::app {

Columns columns_of(const std::string& header, const std::string& file, long line) {
  if (first_bad_byte(header) != std::string::npos) throw InputError(file, line, "", "is not UTF-8 text");
  const auto fields = csv_fields(header);
  if (!fields) throw InputError(file, line, "", "a quote is left open");
  Columns columns{-1, -1, -1, fields->size()};
  for (std::size_t i = 0; i < fields->size(); ++i) {
    std::string field = (*fields)[i];
    if (i == 0 && field.starts_with("\xEF\xBB\xBF")) field.erase(0, 3);
    while (!field.empty() && field.back() == ' ') field.pop_back();
    while (!field.empty() && field.front() == ' ') field.erase(0, 1);
    if (field == "reading_m" || (field == "range_m" && columns.reading < 0))
      columns.reading = static_cast<int>(i);
    if (field == "true_m") columns.truth = static_cast<int>(i);
    if (field == "time_s") columns.time = static_cast<int>(i);
  }
  if (columns.reading < 0)
    throw InputError(file, line, "",
                     "there is no column reading_m or range_m, and the first line is no number");
  return columns;
}

}  // namespace rangecal::app
