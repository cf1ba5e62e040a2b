"""What `benchmarks/bench.py` is made of: problems, candidates, timing, floor, acceptance, report."""
