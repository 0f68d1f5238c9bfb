# Blind check of `diagnose` (tests/blind/README.md).  Default: fresh cases from operating-system entropy.
#   make blind                          about 400 cases with an effect, 300 without
#   make blind CASES=100 GAP_FREE=60    fewer
#   make blind BLIND_SEED=123456        repeat a draw
#   make blind BLIND_ARGS=--resume      go on with an interrupted one
#   make blind-confusions SEED=7 CASES=120   why causes of a development draw were not named
#   make blind-compare BEFORE=old/diagnose   asks another build the questions of a draw made with BLIND_ARGS=--keep-logs (OUT=)
#   make blind-dev SEED=7 CASES=30      development cases with open labels in build/blind-dev (seeds 0 to 999)
CASES ?= 400
GAP_FREE ?= 300
BLIND_SEED ?=
BLIND_ARGS ?=
BLIND = PYTHONPATH=tests OMP_NUM_THREADS=1 nice -n 5 $(PYTHON) -m blind

blind:: host  ## campaign: score diagnose on fresh cases whose labels it cannot see (CASES= GAP_FREE= BLIND_SEED=)
	$(Q)$(BLIND) check --diagnose $(BUILD)/bin/diagnose --errormodel $(BUILD)/bin/errormodel --out $(BUILD)/blind \
	  --cases $(CASES) --gap-free $(GAP_FREE) $(if $(BLIND_SEED),--seed $(BLIND_SEED)) $(BLIND_ARGS)

# CASES= GAP_FREE= as above; SEED= 0 to 999
blind-confusions: host $(BUILD)/bench/oracle  ## campaign: why singles and pairs of a development draw were not named (SEED= CASES=)
	$(Q)$(BLIND) check --diagnose $(BUILD)/bin/diagnose --errormodel $(BUILD)/bin/errormodel --out $(BUILD)/blind-confusions \
	  --cases $(CASES) --gap-free 1 --seed $(or $(SEED),1) --kinds single,pair --keep-logs --no-truth $(BLIND_ARGS)
	$(Q)$(BLIND) confusions --oracle $(BUILD)/bench/oracle --out $(BUILD)/blind-confusions

blind-compare: $(BUILD)/bin/errormodel  ## campaign: ask another build of diagnose the questions of a kept draw (BEFORE= OUT=)
	$(if $(BEFORE),,$(error make blind-compare BEFORE=path/of/the/other/diagnose))
	$(Q)$(BLIND) compare --before $(BEFORE) --errormodel $(BUILD)/bin/errormodel --out $(or $(OUT),$(BUILD)/blind) $(BLIND_ARGS)

blind-dev: host  ## campaign: write cases with open labels for work on diagnose (SEED= CASES=)
	$(Q)$(BLIND) dev --errormodel $(BUILD)/bin/errormodel --out $(BUILD)/blind-dev --cases $(CASES) --seed $(or $(SEED),1) $(BLIND_ARGS)

.PHONY: blind blind-compare blind-dev blind-confusions
