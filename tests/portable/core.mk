# The core on other machines: compiled for each with all warnings, its unit tests run under qemu-user, and the same bits as
# on this machine for the same log (firmware/check).  Big-endian: mips.  32 bits: mips, i686.
#   make portable-core [PORTABLE_CORE=mips] [T="link num"]
# tests/system/test_portable_core.py runs a short form: big-endian, without the long runs of kf and health.

PORTABLE_CORE ?= mips i686
PORTABLE_PACKAGES_mips := gcc-mips-linux-gnu libc6-dev-mips-cross qemu-user
PORTABLE_PACKAGES_i686 := gcc-i686-linux-gnu libc6-dev-i386-cross qemu-user
PORTABLE_CC_mips := mips-linux-gnu-gcc
PORTABLE_CC_i686 := i686-linux-gnu-gcc
PORTABLE_RUN_mips := qemu-mips
PORTABLE_RUN_i686 := qemu-i386
# The core needs float arithmetic in float: the registers of the old coprocessor hold more.
PORTABLE_FLAGS_i686 := -msse2 -mfpmath=sse

# Tests of rooms of the core; what a test needs beside the core it includes.
PORTABLE_CORE_TESTS := $(patsubst tests/common/%.c,%,$(wildcard tests/common/test_*.c))
PORTABLE_CORE_SELECTED = $(call some_selected,$(PORTABLE_CORE_TESTS))
PORTABLE_CORE_FLAGS := -std=c99 -ffp-contract=off -Wall -Wextra -Werror -D_GNU_SOURCE -O2 -Itests/portable/include -Icommon -Ifirmware -Itests

# $1 machine
define portable_core_rules
FLAGS_portable_$1 = $$(PORTABLE_CC_$1) $$(CORE_CFLAGS) $$(PORTABLE_FLAGS_$1) $$(PORTABLE_CORE_FLAGS)
$(BUILD)/portable/$1/common/%.o: common/%.c $(BUILD)/flags/portable_$1
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  CC   $$< ($1)")
	$$(Q)$$(PORTABLE_CC_$1) $$(CORE_CFLAGS) -O2 $$(PORTABLE_FLAGS_$1) -MMD -MP -Icommon -c $$< -o $$@

$(BUILD)/portable/$1/test_%: tests/common/test_%.c tests/portable/include/cmocka.h $$(CORE_SOURCES:%.c=$(BUILD)/portable/$1/%.o)
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  LINK $$@")
	$$(Q)$$(PORTABLE_CC_$1) $$(PORTABLE_CORE_FLAGS) $$(PORTABLE_FLAGS_$1) -static $$(filter %.c %.o,$$^) -lm -o $$@

$(BUILD)/portable/$1/check: $(FIRMWARE_CHECK) firmware/check/main_posix.c $$(CORE_SOURCES:%.c=$(BUILD)/portable/$1/%.o)
	@mkdir -p $$(@D)
	$$(if $$(V),,@echo "  LINK $$@")
	$$(Q)$$(PORTABLE_CC_$1) $(FIRMWARE_CFLAGS) -D_GNU_SOURCE -O2 $$(PORTABLE_FLAGS_$1) $(FIRMWARE_CPPFLAGS) -static $$(filter %.c %.o,$$^) -o $$@

portable-core-$1: portable-tools-$1
	$$(Q)$$(MAKE) --no-print-directory $$(PORTABLE_CORE_SELECTED:%=$(BUILD)/portable/$1/%) $(BUILD)/portable/$1/check $(BUILD)/firmware/posix/check
	$$(Q)tests/portable/run_core "$1" "$$(PORTABLE_RUN_$1)" "$(BUILD)" $$(PORTABLE_CORE_SELECTED)

portable-tools-$1:
	@command -v $$(PORTABLE_CC_$1) >/dev/null && command -v $$(PORTABLE_RUN_$1) >/dev/null || \
	  { echo "portable-core: $1 needs Debian packages; install them with: apt-get install $$(PORTABLE_PACKAGES_$1)" >&2; exit 1; }

.PHONY: portable-core-$1 portable-tools-$1
-include $$(wildcard $(BUILD)/portable/$1/common/*.d)
endef
$(foreach machine,mips i686,$(eval $(call portable_core_rules,$(machine))))

portable-core: $(PORTABLE_CORE:%=portable-core-%)  ## test: the core's tests big-endian and 32-bit under qemu-user, and the same bits
.PHONY: portable-core
