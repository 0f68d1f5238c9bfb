# Host side.  Every folder of host/lib is a room and becomes one archive build/lib/<room>.a; host/tools/NAME/main.cpp is a
# program, what stands beside it is its text and JSON.  A program links the rooms it names in ROOMS_<program>, so that
# `make build/bin/gyrosim` compiles nothing it does not need.  The map of the rooms: host/README.md.

# From the highest tier to the lowest: the order is the link order, and an arrow goes down only (test_layout.py).
ROOMS := device analysis/diagnose analysis/montecarlo analysis/profile analysis/fit analysis/errormodel analysis/dp \
         physics/sim physics/effects noise io base

ROOMS_calibrate := device analysis/fit physics/sim physics/effects noise io base
ROOMS_gyrosim := device analysis/fit physics/sim physics/effects noise io base
ROOMS_dp := analysis/errormodel analysis/dp physics/sim physics/effects noise io base
ROOMS_errormodel := $(ROOMS_dp)
ROOMS_diagnose := analysis/diagnose physics/effects noise io base
ROOMS_imucal := base

# Libraries of each program: LIBS_<program>.  Linked as needed.
HOST_LIBS ?= -Wl,--as-needed -lserialport -lnlopt -lClp -lz

HOST_CPPFLAGS := -Icommon -Ihost/lib -Ihost/tools -isystem /usr/include/eigen3 -DIMUCAL_VERSION='"$(VERSION)"' -DEIGEN_MPL2_ONLY
HOST_CXXFLAGS := -std=c++17 -pedantic -ffp-contract=off -pthread $(WARNINGS)
comma := ,
SANITIZE_FLAGS := $(if $(SANITIZE),-fsanitize=address$(comma)undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
# Position independent once for all: the same objects serve the programs and the Python package.
PIC := -fPIC -fvisibility=hidden
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
# $1: a folder.  Its objects, program mains apart.
folder_objects = $(if $(BY_FILE),$(call host_objects,$1/*.cpp),$(if $(call host_objects,$1/*.cpp),$(BUILD)/obj/host/$1/room.o))

# A piece is written again when a source is added or taken away.
$(BUILD)/gen/%/room.cpp: %
	@mkdir -p $(@D)
	@printf '#include "%s"\n' $(filter-out %/main.cpp,$(sort $(wildcard $*/*.cpp))) > $@.new
	@if cmp -s $@.new $@; then rm -f $@.new; else mv $@.new $@; fi
# A program: its main and what stands beside it, in one piece.
$(BUILD)/gen/%/program.cpp: %
	@mkdir -p $(@D)
	@printf '#include "%s"\n' $(sort $(wildcard $*/*.cpp)) > $@.new
	@if cmp -s $@.new $@; then rm -f $@.new; else mv $@.new $@; fi

TOOLS := $(notdir $(patsubst %/,%,$(wildcard host/tools/*/)))
HOST_OBJECTS := $(CORE_OBJECTS) $(foreach f,$(ROOMS:%=host/lib/%) $(TOOLS:%=host/tools/%),$(call folder_objects,$f))

host: $(HOST_PROGRAMS)  ## build the host programs into build/bin

# ---- precompiled headers ----
# For sources that are compiled by themselves: tests, and the library with BY_FILE=1.  PCH= (empty) builds without;
# sources compiled with flags of their own read the headers as usual.
PCH ?= 1
PCH_lib := $(BUILD)/pch/lib.h
PCH_tools := $(BUILD)/pch/tools.h
USE_PCH = $(if $(PCH),-include $1)
NEEDS_PCH = $(if $(PCH),$1.gch)

$(PCH_lib).gch $(PCH_tools).gch: $(BUILD)/pch/%.h.gch: host/pch/%.h
	@mkdir -p $(@D)
	$(if $(V),,@echo "  PCH  $<")
	$(Q)cp $< $(@:.gch=) && $(COMPILE_CXX) -x c++-header -MMD -MP -MF $@.d -MT $@ $(@:.gch=) -o $@
-include $(BUILD)/pch/lib.h.gch.d $(BUILD)/pch/tools.h.gch.d

# ---- objects ----
$(BUILD)/obj/host/%.o: %.c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CCACHE) $(CC) $(CORE_CFLAGS) $(PIC) $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP -Icommon $(CFLAGS) -c $< -o $@

$(BUILD)/obj/host/host/tools/%.o: host/tools/%.cpp | $(call NEEDS_PCH,$(PCH_tools))
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(call USE_PCH,$(PCH_tools)) -MMD -MP -c $< -o $@

$(BUILD)/obj/host/%.o: %.cpp | $(call NEEDS_PCH,$(PCH_lib))
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(call USE_PCH,$(PCH_lib)) -MMD -MP -c $< -o $@

$(BUILD)/obj/host/%/room.o: $(BUILD)/gen/%/room.cpp
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $*")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(IN_ONE_PIECE) -MMD -MP -c $< -o $@

$(BUILD)/obj/host/%/program.o: $(BUILD)/gen/%/program.cpp
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $*")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(IN_ONE_PIECE) -MMD -MP -c $< -o $@

# ---- archives ----
define room_archive
$(BUILD)/lib/$1.a: $(call folder_objects,host/lib/$1)
endef
define tool_archive
$(BUILD)/lib/tools/$1.a: $(call folder_objects,host/tools/$1)
endef
$(foreach room,$(ROOMS),$(eval $(call room_archive,$(room))))
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
                 $(patsubst %,$(BUILD)/lib/%.a,$(or $(ROOMS_$1),$(ROOMS)) common)
endef
$(foreach tool,$(notdir $(HOST_PROGRAMS)),$(eval $(call program_links,$(tool))))

$(BUILD)/bin/%:
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $^ $(LDFLAGS) $(HOST_LIBS) -o $@

.SECONDARY: $(HOST_MAINS:%.cpp=$(BUILD)/obj/host/%.o) $(HOST_MAINS:%/main.cpp=$(BUILD)/gen/%/program.cpp) \
            $(patsubst %,$(BUILD)/gen/host/%/room.cpp,$(ROOMS:%=lib/%) $(TOOLS:%=tools/%))

-include $(shell find $(BUILD)/obj/host -name '*.d' 2>/dev/null)
