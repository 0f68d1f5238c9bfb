# Small errors in common/*.c, one at a time: do the room's unit tests see them?  ROOMS="kf sum" for some.
ROOMS ?=
mutate:  ## campaign: small errors in the core, one at a time: the unit tests must see 95 % (ROOMS="kf sum" for some)
	$(Q)python3 tests/mutate/mutate.py $(ROOMS) --build $(BUILD)

.PHONY: mutate
