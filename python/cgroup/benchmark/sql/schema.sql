-- The columns of problems are the fields of `Problem`, in their order.
create table machines (id text primary key, cpu text, cores integer, system text, python text, numpy text);
create table datasets (name text primary key, title text, role text, origin text, citation text);
create table solvers (key text primary key, name text, options text, refined integer);
create table problems (
    key text primary key, task, dataset, pair, kind, other, nuisance, level real, matches, nms_radius,
    front, voxel, size, repeats, seed, origin text, protocols text
);
create table matches (problem text primary key references problems, n integer, content blob);
create table results (
    problem text references problems, solver text references solvers, threads integer, epsilons text,
    time_limit real, seconds real, mask blob, pose blob, numbers text, skipped text, error text,
    version text, machine text, created text, primary key (problem, solver, threads)
) without rowid;

create table plan (config text, missing text);
create table plan_sets (
    entry integer primary key, task text, id text, definition text, threads text, epsilons text,
    time_limit real
);
create table plan_problems (entry integer, problem text, place integer, primary key (entry, problem));
create table plan_solvers (
    entry integer, solver text, label text, place integer, primary key (entry, solver)
);
create view wanted as
    select problem, solver, t.value as threads, task, min(entry) as entry, min(p.place) as place,
           min(s.place) as solver_place, min(label) as label, max(time_limit) as time_limit,
           json_group_array(distinct e.value) as epsilons
    from plan_sets join plan_problems p using (entry) join plan_solvers s using (entry)
         join json_each(plan_sets.threads) t left join json_each(plan_sets.epsilons) e
    group by problem, solver, t.value;
