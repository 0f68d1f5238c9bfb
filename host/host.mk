# Host side.  Every folder of host/lib is a room and becomes one archive build/lib/<room>.a, with the rooms inside it;
# host/tools/NAME/main.cpp is a program, what stands beside it is its text and JSON.  A program links the rooms it names in
# ROOMS_<program>, so that `make build/bin/gyrosim` compiles nothing it does not need.  The map of the rooms: host/README.md.

# From the highest tier to the lowest: the order is the link order, and an arrow goes down only.  A program takes
# the rooms that its #includes reach (test_layout.py compares both).
HOST_ROOMS := device analysis/diagnose analysis/montecarlo analysis/profile analysis/fit analysis/errormodel analysis/dp \
              physics/sim physics/effects noise linear io base

ROOMS_calibrate := device analysis/fit physics/sim physics/effects noise linear io base
ROOMS_gyrosim := device analysis/fit physics/sim physics/effects noise linear io base
ROOMS_dp := analysis/errormodel analysis/dp physics/effects noise linear io base
ROOMS_errormodel := $(ROOMS_dp)
ROOMS_montecarlo := $(filter-out device analysis/diagnose,$(HOST_ROOMS))
ROOMS_profile := analysis/profile physics/effects noise linear io base
ROOMS_diagnose := analysis/diagnose physics/effects noise linear io base
ROOMS_imucal := base

# Libraries of each program: LIBS_<program>.  Linked as needed.
HOST_LIBS ?= -Wl,--as-needed -lserialport -lnlopt -lClp -lz

HOST_CPPFLAGS := -Icommon -Ihost/lib -Ihost/tools -isystem /usr/include/eigen3 -DIMUCAL_VERSION='"$(VERSION)"' -DEIGEN_MPL2_ONLY
HOST_CXXFLAGS := -std=c++17 -pedantic -ffp-contract=off -pthread $(WARNINGS)
SANITIZE_FLAGS := $(if $(SANITIZE),-fsanitize=address$(comma)undefined -fno-sanitize-recover=all -fno-omit-frame-pointer -g1)
# Position independent once for all: the same objects serve the programs and the Python package.
PIC := -fPIC -fvisibility=hidden
# GCC tidies up its own memory from 128 MB on; with 1 GB it does so seldom, which saves 6 % of the time.
HOST_CXXFLAGS += $(if $(findstring clang,$(CXX)),,--param ggc-min-heapsize=1048576)
COMPILE_CXX = $(CXX) $(HOST_CXXFLAGS) $(PIC) $(OPTIMISE) $(SANITIZE_FLAGS) $(HOST_CPPFLAGS) $(CXXFLAGS)

CORE_SOURCES := $(wildcard common/*.c)
HOST_MAINS := $(wildcard host/tools/*/main.cpp)
HOST_PROGRAMS := $(HOST_MAINS:host/tools/%/main.cpp=$(BUILD)/bin/%)
# Objects of the sources matching $1.
host_objects = $(patsubst %.cpp,$(BUILD)/obj/host/%.o,$(filter-out $(HOST_MAINS),$(wildcard $1)))
CORE_OBJECTS := $(CORE_SOURCES:%.c=$(BUILD)/obj/host/%.o)
# The whole library in one archive, for tests, benchmarks and strangers.
HOST_ARCHIVE := $(BUILD)/lib/libimucal.a

# ---- one compilation a room ----
# Much of the compile time would go to reading and instantiating Eigen and JSON again for every file.  So a room is
# compiled in one piece: build/gen/<room>/room.cpp names its sources one after the other.  BY_FILE=1 compiles every source
# by itself: quicker after a small change in a large room; with PCH= too it shows a missing include.
BY_FILE ?=
# A source that is read from another one would pass for a header, whose types must not be of one file only.
IN_ONE_PIECE := -iquote . $(if $(findstring clang,$(CXX)),,-Wno-subobject-linkage)
# Sources of a folder and of the rooms inside it.
sources_in = $(sort $(wildcard $1/*.cpp $1/*/*.cpp))
# $1: a folder.  Its objects, program mains apart.
folder_objects = $(if $(BY_FILE),$(call host_objects,$1/*.cpp $1/*/*.cpp),$(if $(call host_objects,$1/*.cpp),$(BUILD)/obj/host/$1/room.o))

# A piece is written again when a source is added or taken away.
$(BUILD)/gen/%/room.cpp: %
	@mkdir -p $(@D)
	@printf '#include "%s"\n' $(filter-out %/main.cpp,$(call sources_in,$*)) > $@.new
	@if cmp -s $@.new $@; then rm -f $@.new; else mv $@.new $@; fi
# A program: its main and what stands beside it, in one piece.
$(BUILD)/gen/%/program.cpp: %
	@mkdir -p $(@D)
	@printf '#include "%s"\n' $(call sources_in,$*) > $@.new
	@if cmp -s $@.new $@; then rm -f $@.new; else mv $@.new $@; fi

$(foreach room,$(HOST_ROOMS),$(eval $(BUILD)/gen/host/lib/$(room)/room.cpp: $(wildcard host/lib/$(room)/*/)))

TOOLS := $(notdir $(patsubst %/,%,$(wildcard host/tools/*/)))
HOST_OBJECTS := $(CORE_OBJECTS) $(foreach f,$(HOST_ROOMS:%=host/lib/%) $(TOOLS:%=host/tools/%),$(call folder_objects,$f))

host: $(HOST_PROGRAMS)  ## build: build the host programs into build/bin

# ---- precompiled headers ----
# For sources that are compiled by themselves: tests, and everything with BY_FILE=1.  A room in one piece is as quick
# without (a precompiled header of 140 MB is read and searched by the compiler too).  PCH= (empty) builds without.
PCH ?= 1
PCH_HEADER := $(BUILD)/pch/heavy.h
USE_PCH = $(if $(PCH),-include $(PCH_HEADER))
NEEDS_PCH := $(if $(PCH),$(PCH_HEADER).gch)
# A precompiled header differs from run to run in bytes that mean nothing; ccache compares what it was made of.
export CCACHE_PCH_EXTSUM ?= 1
export CCACHE_SLOPPINESS ?= pch_defines,time_macros,include_file_ctime,include_file_mtime

$(PCH_HEADER).gch: host/pch/heavy.h $(BUILD)/flags/host_cxx
	@mkdir -p $(@D)
	$(if $(V),,@echo "  PCH  $<")
	$(Q)cp $< $(PCH_HEADER) && $(COMPILE_CXX) -x c++-header -MMD -MP -MF $@.d -MT $@ $(PCH_HEADER) -o $@.new
	$(Q)$(COMPILE_CXX) -E $< | sha256sum > $@.sum && mv $@.new $@
-include $(PCH_HEADER).gch.d

# ---- objects ----
# Not in them: what single files and rooms take beside.  The libraries are: what links has no stamp of its own.
FLAGS_host_c = $(CC) $(CORE_CFLAGS) $(FIRMWARE_CFLAGS) $(PIC) $(OPTIMISE) $(SANITIZE_FLAGS) $(CFLAGS) $(LDFLAGS)
FLAGS_host_cxx = $(COMPILE_CXX) $(IN_ONE_PIECE) $(if $(PCH),PCH) $(LDFLAGS) $(HOST_LIBS)
# The filter reads pairs of floats that it has just written one by one: loaded as one vector they wait for both stores.
# Without such vectors an update takes two thirds of the time; the bits are the same.
$(BUILD)/obj/host/common/kf.o: private OPTIMISE += -fno-tree-slp-vectorize
$(BUILD)/obj/host/%.o: %.c $(BUILD)/flags/host_c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CCACHE) $(CC) $(CORE_CFLAGS) $(PIC) $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP -Icommon $(CFLAGS) -c $< -o $@

$(BUILD)/obj/host/%.o: %.cpp $(BUILD)/flags/host_cxx | $(NEEDS_PCH)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(USE_PCH) -MMD -MP -c $< -o $@

define piece
@mkdir -p $(@D)
$(if $(V),,@echo "  CXX  $*")
$(Q)$(CCACHE) $(COMPILE_CXX) $(IN_ONE_PIECE) -MMD -MP -c $< -o $@
endef
$(BUILD)/obj/host/%/room.o: $(BUILD)/gen/%/room.cpp $(BUILD)/flags/host_cxx
	$(piece)
$(BUILD)/obj/host/%/program.o: $(BUILD)/gen/%/program.cpp $(BUILD)/flags/host_cxx
	$(piece)

PIECES := $(foreach f,$(HOST_ROOMS:%=host/lib/%) $(TOOLS:%=host/tools/%),$(BUILD)/obj/host/$f/room.o $(BUILD)/obj/host/$f/program.o)
# Text, JSON and command lines take no time at run time, and -Og compiles a third quicker than -O2.
QUICK_TO_COMPILE := host/tools/% host/lib/device/%
$(filter $(QUICK_TO_COMPILE:%=$(BUILD)/obj/host/%),$(PIECES)): private OPTIMISE := $(if $(DEBUG),$(OPTIMISE),-Og)
# The loops that take the time are in noise and dp: with -O1 these rooms take 1.5 % more instructions at most, and compile
# in three quarters of the time.
AS_QUICK_WITH_O1 := host/lib/analysis/diagnose/% host/lib/analysis/errormodel/% host/lib/analysis/fit/% host/lib/physics/effects/%
$(filter $(AS_QUICK_WITH_O1:%=$(BUILD)/obj/host/%),$(PIECES)): private OPTIMISE := $(if $(DEBUG),$(OPTIMISE),-O1)

# ---- archives ----
define room_archive
$(BUILD)/lib/$1.a: $(call folder_objects,host/lib/$1)
endef
define tool_archive
$(BUILD)/lib/tools/$1.a: $(call folder_objects,host/tools/$1)
endef
$(foreach room,$(HOST_ROOMS),$(eval $(call room_archive,$(room))))
$(foreach tool,$(TOOLS),$(eval $(call tool_archive,$(tool))))
$(BUILD)/lib/common.a: $(CORE_OBJECTS)
$(HOST_ARCHIVE): $(HOST_OBJECTS)

$(BUILD)/lib/%.a:
	@mkdir -p $(@D)
	$(Q)rm -f $@ && $(AR) rcs $@ $^

# ---- programs ----
define program_links
$(BUILD)/bin/$1: $(if $(BY_FILE),$(BUILD)/obj/host/host/tools/$1/main.o $(BUILD)/lib/tools/$1.a,$(BUILD)/obj/host/host/tools/$1/program.o) \
                 $(BUILD)/lib/tools/cli.a \
                 $(patsubst %,$(BUILD)/lib/%.a,$(or $(ROOMS_$1),$(HOST_ROOMS)) common)
endef
$(foreach tool,$(notdir $(HOST_PROGRAMS)),$(eval $(call program_links,$(tool))))

$(BUILD)/bin/%:
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $^ $(LDFLAGS) $(HOST_LIBS) -o $@

.SECONDARY: $(HOST_MAINS:%.cpp=$(BUILD)/obj/host/%.o) $(HOST_MAINS:%/main.cpp=$(BUILD)/gen/%/program.cpp) \
            $(patsubst %,$(BUILD)/gen/host/%/room.cpp,$(HOST_ROOMS:%=lib/%) $(TOOLS:%=tools/%))

-include $(shell find $(BUILD)/obj/host -name '*.d' 2>/dev/null)
