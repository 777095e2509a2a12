#!/usr/bin/env Rscript
# SPDX-License-Identifier: BSD-3-Clause
# Recordings, and what R's TMB makes of their likelihoods: see README.md. Debian: r-cran-tmb.
#   cd tests/data/joint_specification && Rscript make.R
library(TMB)
invisible(compile("joint_likelihood.cpp", safebounds = FALSE))
dyn.load(dynlib("joint_likelihood"))
set.seed(2021)

laws <- list(f2 = c(2, 0), constant = c(0, 0), f = c(1, 0), f3 = c(3, 0), d2 = c(0, 2), polynomial = NULL)

# The name begins with the noise law.
cases <- list(
  f2 = list(), f2_places = list(places = TRUE), f2_random_walk = list(walk = TRUE), f2_taped = list(taped = TRUE),
  f2_ranges_alone = list(ranges = TRUE), constant = list(), f = list(), f3 = list(), d2 = list(), polynomial = list())
for (name in names(cases)) cases[[name]]$law <- sub("_.*", "", name)

decimals <- function(x) as.numeric(sprintf("%.5f", x))  # what stands in the files

recording <- function(case) {
  K <- 6; L <- 4; repeats <- 2
  alpha <- c(0.0525, 0.8838, 0.0584)
  commanded <- cbind(0.35 * (0:(K - 1)), 0.2 * sin(0:(K - 1)), 0.4 * (0:(K - 1)) - 0.8)
  place <- if (isTRUE(case$places)) c(0, 0, 1, 2, 2, 3) else 0:(K - 1)
  for (k in 2:K) if (place[k] == place[k - 1]) commanded[k, 1:2] <- commanded[k - 1, 1:2]
  commanded <- decimals(commanded); dim(commanded) <- c(K, 3)
  sigma_heading <- if (isTRUE(case$walk)) 0.02 else 0.012
  axis <- cbind(c(0.1, 0.9, 1.5, -0.6), c(1.7, -1.9, 1.2, -0.9))
  error <- cbind(rnorm(K, 0, 0.02), rnorm(K, 0, 0.02), rnorm(K, 0, sigma_heading))
  if (isTRUE(case$walk)) error <- apply(error, 2, cumsum)
  for (k in 2:K) if (place[k] == place[k - 1]) error[k, 1:2] <- error[k - 1, 1:2]
  pose <- commanded + error
  rows <- expand.grid(repeats = seq_len(repeats) - 1, landmark = seq_len(L) - 1, stop = seq_len(K) - 1)
  radius <- c(0.05, 0.12, 0.08, 0.1)
  v <- axis[rows$landmark + 1, ] - pose[rows$stop + 1, 1:2]
  d <- sqrt(rowSums(v^2)) - radius[rows$landmark + 1]
  f <- alpha[1] + alpha[2] * d + alpha[3] * d^2
  beta <- c(0.012, 0.004, 0.006)
  spread <- switch(case$law, polynomial = beta[1] + beta[2] * d + beta[3] * d^2,
                   0.012 * f^laws[[case$law]][1] * d^laws[[case$law]][2])
  off <- atan2(v[, 2], v[, 1]) - pose[rows$stop + 1, 3] + rnorm(nrow(rows), 0, 0.01)
  data <- list(
    stop = rows$stop, landmark = rows$landmark, range = decimals(rnorm(nrow(rows), f, spread)),
    bearing = if (isTRUE(case$ranges)) numeric(0) else decimals(atan2(sin(off), cos(off))), radius = radius,
    commanded = commanded, place = place, sigma_heading = rep(sigma_heading, K), random_walk = as.integer(isTRUE(case$walk)),
    power_of_f = as.integer(if (case$law == "polynomial") 0 else laws[[case$law]][1]),
    power_of_d = as.integer(if (case$law == "polynomial") 0 else laws[[case$law]][2]),
    polynomial = as.integer(case$law == "polynomial"),
    from = if (isTRUE(case$taped)) 0L else integer(0), to = if (isTRUE(case$taped)) 2L else integer(0),
    tape = if (isTRUE(case$taped)) 1.48 else numeric(0), sigma_tape = if (isTRUE(case$taped)) 0.004 else numeric(0))
  # beside the truth, so that every term counts
  at <- list(
    alpha = alpha + c(0.01, -0.02, 0.003), tau = if (case$law == "polynomial") 1.1 * beta else log(0.014),
    log_sigma_theta = log(0.011), log_sigma_s = log(0.015), landmark_axis = axis + cbind(rep(0.02, L), rep(-0.01, L)),
    place_position = commanded[!duplicated(place), 1:2] + 0.4 * error[!duplicated(place), 1:2],
    heading = commanded[, 3] + 0.4 * error[, 3])
  list(data = data, at = at, rows = rows, repeats = repeats)
}

number <- function(x) sprintf("%.17g", x)

write_recording <- function(folder, case, made) {
  dir.create(folder, showWarnings = FALSE)
  d <- made$data
  writeLines(c(
    "format: rangecal/1", "sensor: {name: specification, range_min_m: 0.01, range_max_m: 100}",
    sprintf("stops: {sigma_xy_m: 0.02, sigma_heading_rad: %s, error: %s}", d$sigma_heading[1],
            if (d$random_walk == 1) "random_walk" else "independent"),
    if (length(d$tape) > 0)
      sprintf("known_distances: [{from: A, to: C, distance_m: %s, sigma_m: %s}]", d$tape, d$sigma_tape)),
    file.path(folder, "recording.yaml"))
  label <- LETTERS[1:4]
  write.csv(data.frame(landmark = label, radius_m = d$radius), file.path(folder, "landmarks.csv"), row.names = FALSE, quote = FALSE)
  stops <- data.frame(stop = seq_along(d$place) - 1, x_m = number(d$commanded[, 1]), y_m = number(d$commanded[, 2]),
                      heading_rad = number(d$commanded[, 3]))
  if (isTRUE(case$places)) stops$place <- d$place
  write.csv(stops, file.path(folder, "stops.csv"), row.names = FALSE, quote = FALSE)
  readings <- data.frame(stop = d$stop, landmark = label[d$landmark + 1], `repeat` = made$rows$repeats,
                         range_m = sprintf("%.5f", d$range), check.names = FALSE)
  if (length(d$bearing) > 0) readings$bearing_rad <- sprintf("%.5f", d$bearing)
  write.csv(readings, file.path(folder, "observations.csv"), row.names = FALSE, quote = FALSE)
}

values <- NULL
state <- function(case, what, parameters) {  # matrices by row: x, y of the first, then of the next
  for (name in names(parameters)) {
    p <- parameters[[name]]
    told(case, what, name, if (is.matrix(p)) as.vector(t(p)) else p)
  }
}
told <- function(case, what, name, x)
  values <<- rbind(values, data.frame(case = case, what = what, name = name, index = seq_along(x) - 1, value = number(x)))

# Slopes in the order of a list of parameters, by name.
by_name <- function(gradient, names_of, like) {
  slopes <- like
  for (name in names(like)) if (any(names_of == name)) slopes[[name]][] <- gradient[names_of == name]
  slopes[names(like) %in% names_of]
}

for (name in names(cases)) {
  case <- cases[[name]]
  made <- recording(case)
  write_recording(name, case, made)
  exact <- list(tol = 1e-12, tol10 = 0, grad.tol = 1e-11)
  fixed <- if (isTRUE(case$ranges)) list(log_sigma_theta = factor(NA)) else list()
  # The joint NLL and its slopes.
  joint <- MakeADFun(made$data, made$at, map = fixed, DLL = "joint_likelihood", silent = TRUE)
  state(name, "at", made$at)
  told(name, "joint_nll", "", joint$fn(joint$par))
  state(name, "joint_slope", by_name(joint$gr(joint$par), names(joint$par), made$at))
  # The stops integrated out by Laplace's method.
  marginal <- MakeADFun(made$data, made$at, map = fixed, random = c("place_position", "heading"), DLL = "joint_likelihood",
                        silent = TRUE, inner.control = exact)
  told(name, "marginal_nll", "", marginal$fn(marginal$par))
  state(name, "marginal_slope", by_name(marginal$gr(marginal$par), names(marginal$par), made$at))
  # Curve and landmarks as well, at their joint optimum given the sigmas: slopes in these.
  restricted <- MakeADFun(made$data, made$at, map = fixed, random = c("place_position", "heading", "alpha", "landmark_axis"),
                          DLL = "joint_likelihood", silent = TRUE, inner.control = exact)
  told(name, "restricted_nll", "", restricted$fn(restricted$par))
  state(name, "restricted_slope", by_name(restricted$gr(restricted$par), names(restricted$par), made$at))
}
write.csv(values, "values.csv", row.names = FALSE, quote = FALSE)
invisible(file.remove(Sys.glob(c("*.o", "*.so"))))
