//! Scene → film.
