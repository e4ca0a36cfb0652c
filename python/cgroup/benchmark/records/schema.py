"""Layout of the records' file, and the queries for what it lacks."""

SCHEMA_VERSION = 1

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

# Cases of one pair follow each other, so that a worker loads it once.
CASE_ORDER = "order by dataset, pair, nuisance, level, nms_radius, combination"

PENDING_CASES = """
select {} from wanted_cases join cases on cases.key = case_key
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
