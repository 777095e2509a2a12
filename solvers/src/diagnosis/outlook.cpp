// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/outlook.hpp"

namespace rangecal::diagnosis {

void add_outlook(const Rows&, const SearchResult&, const DiagnoseOptions&, Diagnosis&) {}

}  // namespace rangecal::diagnosis
