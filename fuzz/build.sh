#!/bin/sh
# Builds the target `any` with the flags of `cargo fuzz build -s none`, which stable compilers take, too.
set -eu
cd "$(dirname "$0")"
llvm="-Cllvm-args=-sanitizer-coverage-"
export RUSTFLAGS="-Cpasses=sancov-module ${llvm}level=4 ${llvm}inline-8bit-counters ${llvm}pc-table ${llvm}trace-compares
    -Cllvm-args=-simplifycfg-branch-fold-threshold=0 --cfg fuzzing"
# With a target, the flags are not those of build scripts.
target=$(rustc -vV | sed -n 's/host: //p')
cargo build --release --target "$target" --bin any "$@"
mkdir -p target/bin
cp "target/$target/release/any" target/bin/new
mv target/bin/new target/bin/any
