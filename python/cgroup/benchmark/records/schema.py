"""Layout of the records' file, and the queries for what it lacks."""

PLAN_TABLES = (
    *("plan", "plan_experiments", "plan_cases", "plan_methods", "plan_epsilons", "plan_timing"),
    *("plan_sets", "plan_pairs", "plan_pipelines"),
    *("plan_trials", "plan_problems", "plan_candidates", "plan_threads"),
)
"""What the latest configuration asks for."""

SCHEMA = """
create table machines (
    id text primary key, cpu text, cores integer, system text, python text, numpy text
) without rowid;
create table datasets (
    name text primary key, title text, role text, origin text, citation text
) without rowid;
create table methods (key text primary key, name text, options text) without rowid;
create table cases (
    key text primary key, dataset text, pair text, origin text, protocols text, nuisance text, level real,
    combination text, detector text, descriptor text, nms_radius real, seed integer
) without rowid;

create table correspondences (
    case_key text primary key references cases, n integer, pr real, facts text, seconds text,
    parameters text, error text, version text, machine text, created text
) without rowid;
-- Apart, since reading a column behind a large one means reading that too.
create table arrays (case_key text primary key references cases, content blob, truth blob, sample blob);
create table groupings (
    case_key text references cases, method_key text references methods, mask blob, seconds real,
    threshold real, pose blob, diagnostics text, parameters text, error text, version text, machine text,
    created text, primary key (case_key, method_key)
) without rowid;
create table scores (
    case_key text, method_key text, epsilon real, correct integer, selected integer,
    selected_correct integer, rotation_error real, translation_error real, rmse real, protocols text,
    primary key (case_key, method_key, epsilon)
) without rowid;

create table timing_sets (
    key text primary key, dataset text, pair text, size integer, n integer, content blob
);
create table timings (
    set_key text references timing_sets, method_key text references methods, threads integer,
    machine text references machines, repeat integer, seconds real, version text, created text,
    primary key (set_key, method_key, threads, machine, repeat)
) without rowid;
create table timing_skips (
    set_key text references timing_sets, method_key text references methods, threads integer,
    machine text references machines, reason text, primary key (set_key, method_key, threads, machine)
) without rowid;

create table plan (name text, seed integer, config text, missing text);
create table plan_experiments (entry integer primary key, id text, definition text);
create table plan_cases (entry integer, case_key text, primary key (entry, case_key)) without rowid;
create table plan_methods (
    entry integer, method_key text, label text, place integer, primary key (entry, method_key)
) without rowid;
create table plan_epsilons (entry integer, epsilon real, primary key (entry, epsilon)) without rowid;
create table plan_timing (set_key text, method_key text, label text, place integer);

create view wanted_cases as select distinct case_key from plan_cases;
create view wanted_groupings as
    select distinct case_key, method_key from plan_cases join plan_methods using (entry);
create view wanted_scores as
    select case_key, method_key, epsilon, min(label) as label, min(place) as place,
           json_group_array(distinct id) as experiments
    from plan_cases join plan_methods using (entry) join plan_epsilons using (entry)
         join plan_experiments using (entry)
    group by case_key, method_key, epsilon;
"""

REGISTRATION_SCHEMA = """
create table pair_cases (
    key text primary key, dataset text, pair text, origin text, kind text, other text, voxel real,
    seed integer
) without rowid;
create table pipelines (key text primary key, name text, options text, refined integer) without rowid;
create table registrations (
    case_key text references pair_cases, pipeline_key text references pipelines, threads integer,
    voxel real, pr real, overlap real, pose blob, ok integer, probability real, rotation_error real,
    translation_error real, rmse real, seconds text, error text, version text, machine text, created text,
    primary key (case_key, pipeline_key, threads)
) without rowid;

create table plan_sets (entry integer primary key, id text, threads integer, definition text);
create table plan_pairs (entry integer, case_key text, primary key (entry, case_key)) without rowid;
create table plan_pipelines (
    entry integer, pipeline_key text, label text, place integer, primary key (entry, pipeline_key)
) without rowid;

create view wanted_registrations as
    select distinct case_key, pipeline_key, threads
    from plan_pairs join plan_pipelines using (entry) join plan_sets using (entry);
"""
"""Tables that were added in version 2."""

TRIAL_SCHEMA = """
create table problems (
    key text primary key, dataset text, pair text, origin text, kind text, other text, matches text,
    voxel real, epsilon real, seed integer
) without rowid;
create table trials (
    case_key text references problems, method_key text references methods, threads integer, time_limit real,
    n integer, correct integer, resolution real, pr real, overlap real, selected integer,
    selected_correct integer, posed integer, ok integer, complete integer, rotation_error real,
    translation_error real, rmse real, best_rotation_error real, best_translation_error real, best_rmse real,
    offered integer, seconds real, mebibytes real, diagnostics text, skipped text, error text, version text,
    machine text, created text,
    primary key (case_key, method_key, threads)
) without rowid;

create table plan_trials (entry integer primary key, id text, time_limit real, definition text);
create table plan_problems (
    entry integer, case_key text, place integer, primary key (entry, case_key)
) without rowid;
create table plan_candidates (
    entry integer, method_key text, label text, place integer, primary key (entry, method_key)
) without rowid;
create table plan_threads (entry integer, threads integer, primary key (entry, threads)) without rowid;

create view wanted_trials as
    select case_key, method_key, threads, min(entry) as entry, min(p.place) as place,
           min(m.place) as method_place, max(time_limit) as time_limit
    from plan_problems p join plan_candidates m using (entry) join plan_threads using (entry)
         join plan_trials using (entry)
    group by case_key, method_key, threads;
"""
"""Tables that were added in version 3."""

FRONT_SCHEMA = """
create table fronts (
    case_key text primary key references cases, changes text not null, checksum blob
) without rowid;
"""
"""Tables that were added in version 5."""

# Cases of one pair follow each other, so that a worker loads it once.
CASE_ORDER = "order by dataset, pair, nuisance, level, nms_radius, combination"

PAIR_ORDER = "order by dataset, pair, kind, other"

PENDING_REGISTRATIONS = """
select {} from wanted_registrations w join pair_cases on pair_cases.key = w.case_key
where not exists (
    select 1 from registrations r
    where r.case_key = w.case_key and r.pipeline_key = w.pipeline_key and r.threads = w.threads)
"""

# What was given up for want of time is tried again once it is given more.
PENDING_TRIALS = """
select {} from wanted_trials w join problems on problems.key = w.case_key
where not exists (
    select 1 from trials t
    where t.case_key = w.case_key and t.method_key = w.method_key and t.threads = w.threads
        and (t.skipped = '' or t.time_limit >= w.time_limit))
order by w.threads, w.entry, w.place, w.case_key, w.method_place
"""

PENDING_CASES = """
select {} from wanted_cases w join cases on cases.key = w.case_key
    left join fronts on fronts.case_key = cases.key
where not exists (select 1 from correspondences c where c.case_key = cases.key)
"""

PENDING_GROUPINGS = """
select {} from wanted_groupings w join cases on cases.key = w.case_key
    join correspondences c on c.case_key = w.case_key and c.error = ''
where not exists (
    select 1 from groupings g where g.case_key = w.case_key and g.method_key = w.method_key)
"""

PENDING_SCORES = """
select {} from wanted_scores w
    join groupings g on g.case_key = w.case_key and g.method_key = w.method_key and g.error = ''
where not exists (
    select 1 from scores s
    where s.case_key = w.case_key and s.method_key = w.method_key and s.epsilon = w.epsilon)
"""

# The method or pipeline (empty for the first stage), the error, and how often, by the table of the records.
FAILURES = {
    "correspondences": """
select '', error, count(*) from wanted_cases join correspondences using (case_key)
where error <> '' group by error
""",
    "groupings": """
select label, error, count(*) from groupings join (
    select case_key, method_key, min(label) as label
    from plan_cases join plan_methods using (entry) group by case_key, method_key
) using (case_key, method_key)
where error <> '' group by label, error
""",
    "registrations": """
select label, error, count(*) from registrations join (
    select case_key, pipeline_key, threads, min(label) as label
    from plan_pairs join plan_pipelines using (entry) join plan_sets using (entry)
    group by case_key, pipeline_key, threads
) using (case_key, pipeline_key, threads)
where error <> '' group by label, error
""",
    "trials": """
select label, error, count(*) from trials join (
    select case_key, method_key, threads, min(label) as label
    from plan_problems join plan_candidates using (entry) join plan_threads using (entry)
    group by case_key, method_key, threads
) using (case_key, method_key, threads)
where error <> '' group by label, error
""",
}
