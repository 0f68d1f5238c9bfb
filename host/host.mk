# Host side.  Every folder of host/lib is a room and becomes one archive build/lib/<room>.a; host/tools/NAME/main.cpp is a
# program, what stands beside it is its text and JSON.  A program links the rooms it names in ROOMS_<program>, so that
# `make build/bin/gyrosim` compiles nothing it does not need.  The map of the rooms: host/README.md.

# From the highest tier to the lowest: the order is the link order, and an arrow goes down only (test_layout.py).
ROOMS := device analysis/diagnose analysis/montecarlo analysis/profile analysis/fit analysis/errormodel analysis/dp \
         physics/sim physics/effects noise io base

ROOMS_calibrate := device analysis/fit physics/sim physics/effects noise io base
ROOMS_gyrosim := device physics/sim physics/effects noise io base
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
HOST_OBJECTS := $(CORE_OBJECTS) $(call host_objects,host/lib/*/*.cpp host/lib/*/*/*.cpp host/tools/*/*.cpp)

host: $(HOST_PROGRAMS)  ## build the host programs into build/bin

# ---- precompiled headers ----
# Half of the compile time would go to reading Eigen and JSON again for every file.  PCH= (empty) builds without, and so
# shows a missing include; sources compiled with flags of their own read the headers as usual.
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

# ---- archives ----
define room_archive
$(BUILD)/lib/$1.a: $(call host_objects,host/lib/$1/*.cpp)
endef
define tool_archive
$(BUILD)/lib/tools/$1.a: $(call host_objects,host/tools/$1/*.cpp)
endef
TOOLS := $(notdir $(patsubst %/,%,$(wildcard host/tools/*/)))
$(foreach room,$(ROOMS),$(eval $(call room_archive,$(room))))
$(foreach tool,$(TOOLS),$(eval $(call tool_archive,$(tool))))
$(BUILD)/lib/common.a: $(CORE_OBJECTS)
$(HOST_ARCHIVE): $(HOST_OBJECTS)

$(BUILD)/lib/%.a:
	@mkdir -p $(@D)
	$(Q)rm -f $@ && $(AR) rcs $@ $^

# ---- programs ----
define program_links
$(BUILD)/bin/$1: $(BUILD)/obj/host/host/tools/$1/main.o $(BUILD)/lib/tools/$1.a $(BUILD)/lib/tools/cli.a \
                 $(patsubst %,$(BUILD)/lib/%.a,$(or $(ROOMS_$1),$(ROOMS)) common)
endef
$(foreach tool,$(notdir $(HOST_PROGRAMS)),$(eval $(call program_links,$(tool))))

$(BUILD)/bin/%:
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $^ $(LDFLAGS) $(HOST_LIBS) -o $@

.SECONDARY: $(HOST_MAINS:%.cpp=$(BUILD)/obj/host/%.o)

-include $(shell find $(BUILD)/obj/host -name '*.d' 2>/dev/null)
