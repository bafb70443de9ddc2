"""What pytest-benchmark's JSON holds: names, minima and medians, and in `extra_info` figures, machine and commit."""

from tactsim.bench.machine import machine, versions


def pytest_benchmark_generate_machine_info(config):
    return machine() | versions()


def pytest_benchmark_update_json(config, benchmarks, output_json):
    """Leave out each round's time and other figures that nobody compares: a file is kept for every release."""
    commit, processor = output_json["commit_info"]["id"], output_json["machine_info"]["processor"]
    for one in output_json["benchmarks"]:
        one["stats"] = {name: one["stats"][name] for name in ("min", "median", "rounds")}
        one["extra_info"] |= {"machine": processor, "commit": commit}
        for name in ("group", "options", "param", "params", "fullname"):
            del one[name]
