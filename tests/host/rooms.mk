# A unit test that names its rooms here is linked with those alone, so that it can be built without the rest of the
# library; the others take the whole (tests/tests.mk).

ROOMS_physics := physics/sim physics/effects noise linear io base
ROOMS_test_base := base
ROOMS_test_repeats := base
ROOMS_test_noise := noise io base
ROOMS_test_sim := $(ROOMS_physics)
ROOMS_test_effects := $(ROOMS_physics)
ROOMS_test_effect_memory := $(ROOMS_physics)
ROOMS_test_effect_added := $(ROOMS_physics)
ROOMS_test_sample_findings := $(ROOMS_physics)
ROOMS_test_fit := analysis/fit $(ROOMS_physics)
ROOMS_test_fit_noise := $(ROOMS_test_fit)
ROOMS_test_renewal := $(ROOMS_test_fit)
ROOMS_test_fuzz_files := analysis/fit $(ROOMS_physics)
ROOMS_test_diagnose := analysis/diagnose $(ROOMS_physics)
ROOMS_test_diagnose_causes := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_noise := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_logs := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_held_out := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_verdict := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_where := $(ROOMS_test_diagnose)
ROOMS_test_diagnose_words := tools/diagnose analysis/diagnose $(ROOMS_physics)
ROOMS_test_dp := analysis/errormodel analysis/dp $(ROOMS_physics)
ROOMS_test_errormodel_expect := $(ROOMS_test_dp)
ROOMS_test_errormodel_fit := $(ROOMS_test_dp)
ROOMS_test_profile_bound := analysis/profile $(ROOMS_physics)
ROOMS_test_profile_core := $(ROOMS_test_profile_bound)
ROOMS_test_profile_covariance := $(ROOMS_test_profile_bound)
ROOMS_test_profile_optimize := $(ROOMS_test_profile_bound)

TESTS_WITH_ROOMS := $(foreach t,$(UNIT_TESTS),$(if $(ROOMS_$(notdir $t)),$t))
define test_rooms
$1: $(patsubst %,$(BUILD)/lib/%.a,$(ROOMS_$(notdir $1)) common)
endef
$(foreach t,$(TESTS_WITH_ROOMS),$(eval $(call test_rooms,$t)))

$(TESTS_WITH_ROOMS): $(BUILD)/tests/%: $(BUILD)/obj/host/tests/%.o
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $(filter %.o,$^) $(filter %.a,$^) $(LDFLAGS) $(HOST_LIBS) -lcmocka -lm -o $@
