# SPDX-License-Identifier: BSD-3-Clause
# R's side of the comparison: r_peer.R pairs|joint SIZE SETS FOLDER METHOD CAP.
# nlme_gls, nlme_gnls (pairs): y ~ 1 + d + d^2 with spread sigma |fitted|^2 (varPower, its exponent fixed). Both hold the weights
# while they fit the means: another criterion than the likelihood, whose mean is in the spread.
# r_optim (joint): optim's BFGS with analytic gradient. nlme cannot state this problem: it has no place for stops whose spread is
# known beside readings whose spread is estimated.
suppressPackageStartupMessages(library(nlme))
arguments <- commandArgs(TRUE)
kind <- arguments[1]; size <- as.integer(arguments[2]); sets <- as.integer(arguments[3])
folder <- arguments[4]; method <- arguments[5]; cap <- as.numeric(arguments[6])

status_megabytes <- function(field) {
  line <- grep(field, readLines("/proc/self/status"), value = TRUE)
  as.numeric(gsub("[^0-9]", "", line)) / 1024
}

pairs_problem <- function(path) {
  values <- readBin(path, "double", 2 * size)
  data <- data.frame(d = values[1:size], y = values[size + 1:size])
  law <- varPower(fixed = 2, form = ~ fitted(.))
  if (method == "nlme_gls") {
    function() {
      fit <- gls(y ~ d + I(d^2), data, weights = law, method = "ML")
      c(unname(coef(fit)), log(fit$sigma))
    }
  } else {
    function() {
      start <- setNames(coef(lm(y ~ d + I(d^2), data)), c("a0", "a1", "a2"))
      fit <- gnls(y ~ a0 + d * (a1 + d * a2), data, start = start, weights = law)
      c(unname(coef(fit)), log(fit$sigma * sqrt((size - 3) / size)))
    }
  }
}

joint_problem <- function(path) {
  v <- readBin(path, "double", file.size(path) / 8)
  K <- v[1]; L <- v[2]; n <- v[3]
  column <- function(k) v[3 + k * n + seq_len(n)]
  stop <- column(0) + 1; landmark <- column(1) + 1; y <- column(2); bearing <- column(3); radius <- column(4)
  rest <- v[-seq_len(3 + 5 * n)]
  commanded <- as.vector(rbind(rest[1:K], rest[K + 1:K]))
  sigma <- rest[2 * K + 1]; start <- rest[-seq_len(2 * K + 1)]
  first <- 5 + 2 * L; at <- 5 + 2 * landmark; from <- first + 2 * stop   # of the y of each
  per <- function(values, group, count) { out <- numeric(count); s <- rowsum(values, group); out[as.integer(rownames(s))] <- s; out }
  # optim asks for value and gradient apart; the last point is kept.
  last <- NULL; kept <- NULL
  evaluate <- function(x) {
    if (identical(x, last)) return(kept)
    vx <- x[at - 1] - x[from - 1]; vy <- x[at] - x[from]
    axis <- sqrt(vx^2 + vy^2); ux <- vx / axis; uy <- vy / axis; d <- axis - radius
    f <- x[1] + d * (x[2] + d * x[3])
    if (!(min(f) > 0)) return(list(value = 1e10, gradient = numeric(length(x))))
    turn <- (bearing - atan2(uy, ux) + pi) %% (2 * pi) - pi
    precision <- exp(-2 * x[4]) / f^2; r <- y - f; q <- r^2 * precision; qb <- turn^2 * exp(-2 * x[5])
    e <- (x[-seq_len(first)] - commanded) / sigma
    in_f <- -r * precision + (1 - q) / f; in_d <- in_f * (x[2] + 2 * d * x[3]); in_b <- -turn * exp(-2 * x[5]) / axis
    gx <- in_d * ux - in_b * uy; gy <- in_d * uy + in_b * ux
    last <<- x
    kept <<- list(value = sum(log(f)) + n * (x[4] + x[5]) + 0.5 * (sum(q) + sum(qb) + sum(e^2)),
                  gradient = c(sum(in_f), sum(in_f * d), sum(in_f * d^2), sum(1 - q), sum(1 - qb),
                               rbind(per(gx, landmark, L), per(gy, landmark, L)),
                               e / sigma - as.vector(rbind(per(gx, stop, K), per(gy, stop, K)))))
    kept
  }
  function() {
    last <<- NULL
    optim(start, function(x) evaluate(x)$value, function(x) evaluate(x)$gradient, method = "BFGS",
          control = list(maxit = 5000, reltol = 1e-14))$par
  }
}

spent <- 0
for (set in seq_len(sets) - 1) {
  if (spent > cap) break
  call <- (if (kind == "pairs") pairs_problem else joint_problem)(sprintf("%s/data-%d.bin", folder, set))
  invisible(gc())
  cat("5", file = "/proc/self/clear_refs")
  before <- status_megabytes("VmRSS:"); best <- Inf; begin <- proc.time()[["elapsed"]]
  repeat {
    start_time <- as.numeric(Sys.time())
    answer <- tryCatch(call(), error = function(e) NaN)
    best <- min(best, as.numeric(Sys.time()) - start_time)
    if (proc.time()[["elapsed"]] - begin > 0.05) break
  }
  spent <- spent + proc.time()[["elapsed"]] - begin
  writeBin(as.double(answer), sprintf("%s/%s-%d.bin", folder, method, set))
  cat(set, sprintf("%.9f %.2f\n", best, status_megabytes("VmHWM:") - before))
}
