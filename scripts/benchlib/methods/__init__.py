"""What `bench_peers` sets side by side: each function here makes one solver of a Task."""
