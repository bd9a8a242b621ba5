# Each target is complete in itself, also as the first command on a bare machine.
QUICK = $(addprefix tests/,api export files mesh report scene surface measure/structures \
    optics/calibration optics/geometry optics/sensor)

.PHONY: help demo test quick slow hostile check bench setup clean

help:
	@echo "make demo    runs examples/crane.toml and says where the report is"
	@echo "make test    builds and installs the wheel, runs the tests against it"
	@echo "make quick   within a minute: what opens no device, of the parts that take no time"
	@echo "make slow    the cases that make test leaves out because they take long"
	@echo "make hostile damaged, forged and unbounded input, kills; SEED=7 for other inputs"
	@echo "make check   format, lint, types and tests"
	@echo "make bench   says which benchmarks there are and how to run them"

demo:
	@scripts/setup.sh
	.venv/bin/gpusim run examples/crane.toml -o out/crane
	@echo "report: $(CURDIR)/out/crane/report.html"

test: setup
	scripts/test.sh
	HOSTILE_SHARE=0.03 SEED=34 scripts/test.sh -m hostile --dist load tests/hostile

quick: setup
	scripts/test.sh --without-device --ignore tests/mesh/formats/test_cad.py $(QUICK)

slow: setup
	scripts/test.sh -m slow

hostile: setup
	HOSTILE_SHARE=$${HOSTILE_SHARE:-1} scripts/test.sh -m hostile --dist load tests/hostile

check: setup
	.venv/bin/ruff format --check
	.venv/bin/ruff check
	.venv/bin/mypy --num-workers 2
	$(MAKE) test

bench:
	@echo "Benchmarks (each prints its own options with --help):"
	@grep -l __main__ benchmarks/*.py benchmarks/*/__main__.py | sed \
	    -e 's|/__main__.py||' -e 's|.py$$||' -e 's|/|.|' -e 's|^|  .venv/bin/python -m |'
	@echo "  .venv/bin/gpusim bench solver"
	@echo "  .venv/bin/gpusim bench render"
	@test -x .venv/bin/python || echo "first: scripts/setup.sh dev"

setup:
	@scripts/setup.sh dev

clean:
	rm -rf build out .venv
