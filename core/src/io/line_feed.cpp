// SPDX-License-Identifier: BSD-3-Clause
#include "io/line_feed.hpp"

#include <cstring>
#include <utility>

#include "rangecal/core/utf8.hpp"

namespace rangecal::io {

LineFeed::LineFeed(std::string_view text) : data_(text.data()), end_(text.size()), whole_(true) {
  skip_mark();
}

LineFeed::LineFeed(std::unique_ptr<InputFile> file)
    : file_(std::move(file)), buffer_(std::make_unique_for_overwrite<char[]>(room)), data_(buffer_.get()) {
  while (end_ < byte_order_mark.size() && !whole_) fill();
  skip_mark();
}

void LineFeed::skip_mark() {
  if (std::string_view(data_, end_).starts_with(byte_order_mark)) begin_ = byte_order_mark.size();
}

void LineFeed::fill() {
  if (begin_ > 0) std::memmove(buffer_.get(), data_ + begin_, end_ - begin_);
  end_ -= std::exchange(begin_, 0);
  const std::size_t count = file_->read(buffer_.get() + end_, room - end_);
  end_ += count;
  whole_ = count == 0;
}

LineFeed::Status LineFeed::next(std::string_view& line) {
  std::size_t at = begin_;
  while (true) {
    while (at < end_ && data_[at] != '\n' && data_[at] != '\r') ++at;
    if (at - begin_ > longest) return Status::too_long;
    if (at + 1 < end_ || whole_) break;  // the byte behind says whether a CR has a LF
    at -= begin_;
    fill();
  }
  if (begin_ == end_) return Status::end;
  if (at < end_) at += data_[at] == '\r' && at + 1 < end_ && data_[at + 1] == '\n' ? 2 : 1;
  line = {data_ + begin_, at - begin_};
  begin_ = at;
  return Status::line;
}

}  // namespace rangecal::io
